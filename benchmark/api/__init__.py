"""What authors of methods, descriptors, learners and scorers import.

Each name is imported from its module by itself: the code of a plugin is that of the names that it
uses, see :mod:`benchmark.code_digest`.
"""

from benchmark.api.contracts import (
    CanonicalForm,
    Descriptor,
    FloatArray,
    Input,
    Method,
    MethodInfo,
    Shape,
    canonical_form,
)
from benchmark.api.learning import (
    CARD,
    WEIGHTS,
    Bodies,
    Card,
    Learner,
    MeasuresFit,
    Split,
    TrainingData,
    TrainingPair,
    checked_weights,
    digest_of,
    read_card,
)
from benchmark.api.parameters import CheckedParameters, Interval, Matches
from benchmark.api.scoring import Scorer, ScorerInfo, SignatureArrays
from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.embedding import oriented
from benchmark.geometry.mesh import Mesh

__all__ = [
    "CARD",
    "WEIGHTS",
    "Bodies",
    "CanonicalForm",
    "Card",
    "CheckedParameters",
    "Descriptor",
    "FloatArray",
    "Input",
    "Interval",
    "InvalidMesh",
    "Learner",
    "Matches",
    "MeasuresFit",
    "Mesh",
    "Method",
    "MethodInfo",
    "Scorer",
    "ScorerInfo",
    "Shape",
    "SignatureArrays",
    "Split",
    "TrainingData",
    "TrainingPair",
    "UnsupportedShape",
    "canonical_form",
    "checked_weights",
    "digest_of",
    "oriented",
    "read_card",
]


def __dir__() -> list[str]:
    return __all__

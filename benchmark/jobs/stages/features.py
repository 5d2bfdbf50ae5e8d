"""Signature of a canonical form, as the scorer sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.scoring import Scorer
from benchmark.errors import InvalidSignature
from benchmark.geometry.mesh import Mesh

_HINT = "return a mapping from names to arrays of finite numbers"


def extract(scorer: Scorer, form: Mesh) -> Mapping[str, NDArray[Any]]:
    """Make the signature of a form: named arrays.

    Raises
    ------
    ShapeError
        If the scorer refuses the form, which may have no extent.
    InvalidSignature
        If it returns anything but named arrays of finite numbers.
    """
    answer: object = scorer.signature(form)
    who = f"scorer '{scorer.info.name}'"
    if not isinstance(answer, Mapping) or not answer:
        raise InvalidSignature(f"{who} returned {type(answer).__name__}, not named arrays", _HINT)
    found: dict[str, NDArray[Any]] = {}
    for name, value in answer.items():
        if not (isinstance(name, str) and name.isidentifier()):
            raise InvalidSignature(f"{who} returned an array called {name!r:.80}", "name it like a variable")
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or not np.isfinite(value).all():
            raise InvalidSignature(f"{who} returned '{name}', which is no array of finite numbers", _HINT)
        found[name] = value
    return found

"""What authors of methods, descriptors, learners and scorers import."""

from benchmark.api.contracts import *  # noqa: F403
from benchmark.api.contracts import __all__ as _of_methods
from benchmark.api.learning import *  # noqa: F403
from benchmark.api.learning import __all__ as _of_learners
from benchmark.api.scoring import *  # noqa: F403
from benchmark.api.scoring import __all__ as _of_scorers
from benchmark.geometry.embedding import oriented as oriented

__all__ = sorted({*_of_methods, *_of_learners, *_of_scorers, "oriented"})


def __dir__() -> list[str]:
    return __all__

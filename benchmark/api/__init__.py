"""What authors of methods, descriptors, learners, scorers and data sets import."""

from benchmark.api.contracts import *  # noqa: F403
from benchmark.api.contracts import __all__ as _of_methods
from benchmark.api.datasets import *  # noqa: F403
from benchmark.api.datasets import __all__ as _of_data_sets
from benchmark.api.learning import *  # noqa: F403
from benchmark.api.learning import __all__ as _of_learners
from benchmark.api.scoring import *  # noqa: F403
from benchmark.api.scoring import __all__ as _of_scorers

__all__ = sorted({*_of_methods, *_of_data_sets, *_of_learners, *_of_scorers})


def __dir__() -> list[str]:
    return __all__

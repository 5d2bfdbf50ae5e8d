"""Interface for authors of plugins, and for programs that compute canonical forms of depth images.

Names are imported on first use, so that the imports of one plugin do not affect the keys of others.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmark.api.contracts import *  # noqa: F403
    from benchmark.api.datasets import *  # noqa: F403
    from benchmark.api.learning import *  # noqa: F403
    from benchmark.api.scoring import *  # noqa: F403
    from benchmark.api.streaming import *  # noqa: F403

_MODULES = ("api.contracts", "api.scoring", "api.datasets", "api.learning", "api.streaming", "depth_forms")


def __getattr__(name: str) -> Any:
    """Import a name from one of the modules; raise ``AttributeError`` if none has it."""
    for module in () if name.startswith("_") else _MODULES:
        imported = importlib.import_module(f"benchmark.{module}")
        if name in imported.__all__:
            return getattr(imported, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

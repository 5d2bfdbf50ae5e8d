"""Deprecated names of functions that ``benchmark`` and ``benchmark.commands.forms`` have."""

from __future__ import annotations

import warnings
from typing import Any


def __getattr__(name: str) -> Any:
    """Return a name that has moved to :mod:`benchmark.commands.forms`, with a deprecation warning.

    Python calls this function for names that the module does not define itself.
    """
    from benchmark.commands import forms  # lazy: the import takes long

    if name.startswith("_") or not hasattr(forms, name):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    place = "benchmark" if name == "canonical_form_of_depth" else forms.__name__
    warnings.warn(
        f"'{__name__}.{name}' is deprecated: write 'from {place} import {name}'",
        DeprecationWarning,
        stacklevel=2,
    )
    return getattr(forms, name)

"""Deprecated names of functions that ``benchmark`` and ``benchmark.commands.forms`` have."""

from __future__ import annotations

import warnings
from typing import Any


def __getattr__(name: str) -> Any:
    """Return a name of :mod:`benchmark.commands.forms`, where this module went, with a warning."""
    from benchmark.commands import forms  # it takes long, and is needed for an old name alone

    if name.startswith("_") or not hasattr(forms, name):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    place = "benchmark" if name == "canonical_form_of_depth" else forms.__name__
    warnings.warn(
        f"'{__name__}.{name}' is deprecated: write 'from {place} import {name}'",
        DeprecationWarning,
        stacklevel=2,
    )
    return getattr(forms, name)

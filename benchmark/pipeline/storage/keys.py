"""Keys of recipes. A recipe consists of inputs, versions, parameters and seed, never of output bytes.

Output bytes vary with BLAS builds and thread counts; a recipe does not. Code enters through the versions of the
components that ran; see :mod:`benchmark.pipeline.storage.lock`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def digest(recipe: Any) -> str:
    """Return the digest of a recipe of dicts, lists, strings and numbers: 32 hexadecimal digits."""
    text = json.dumps(recipe, sort_keys=True, separators=(",", ":"), default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def bare_key(key: str) -> str:
    """Return a key without the prefix that names an edit, if any."""
    return key.rpartition("-")[2]


def is_edited(key: str) -> bool:
    """Return whether a key has the prefix that names an edit."""
    return "-" in key


def plain(recipe: Any) -> Any:
    """Return a recipe as read back from JSON, with lists for tuples and Python numbers for NumPy numbers."""
    return json.loads(json.dumps(recipe, sort_keys=True, default=_plain))


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):
        return value.item()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be part of a recipe")

"""Keys of results: digests of everything that determines them, known before they are computed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.code_digest import code_of


def digest(content: Any) -> str:
    """Return the digest of a content of dicts, lists, texts and numbers: 32 hexadecimal digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be part of a key")


class Keys(NamedTuple):
    """Keys of the cached files of a shape for a job; ``signature`` is "" for a descriptor."""

    prepared: str
    form: str
    signature: str


def keys_of(prepared: str, method: Mapping[str, Any], seed: int, model: str, scorer: Mapping[str, Any] | None) -> Keys:
    """Return the keys of a shape, from those of the prepared shape, of the method, its model and the scorer."""
    form = digest([prepared, method, seed, model])
    return Keys(prepared, form, "" if scorer is None else digest([form, scorer]))


def code_of_modules(modules: Iterable[str], files: tuple[str, ...] = ()) -> dict[str, str]:
    """Return what the code of modules consists of: sources, versions of packages, and files beside a plugin file."""
    codes = [_code_of(module, files if module.endswith(".py") else ()) for module in modules]
    return {name: part for code in codes for name, part in code.items()}


_code_of = cache(code_of)

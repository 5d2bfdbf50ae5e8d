"""Processes that import no plugin: what they know of one, its own process has told."""

from __future__ import annotations

import importlib
from typing import Any

_reach = ""


def close_process(reach: str) -> None:
    """Let no foreign code into this process from now on: what it makes is trusted.

    Parameters
    ----------
    reach
        Class of :mod:`benchmark.plugins.remote` that stands for a plugin here: ``"Remote"`` where somebody watches over
        this process, ``"Inspected"`` where it talks to the user.
    """
    global _reach
    _reach = reach


def is_closed() -> bool:
    """Return whether no foreign code may be imported into this process."""
    return bool(_reach)


def reached(spec: Any) -> Any:
    """Return what stands for a plugin in a closed process, with its ``facts`` and a ``create``; None in an open one."""
    if not _reach:
        return None
    kind = getattr(importlib.import_module("benchmark.plugins.remote"), _reach)
    return kind(spec.kind, spec.target, spec.name, spec.base_name)


def facts_of_file(path: str, kind: str) -> list[dict[str, Any]]:
    """Return what a closed process knows of the plugins of a kind in a file, by its absolute path."""
    inspection = importlib.import_module("benchmark.plugins.inspection")
    return [facts for facts in inspection.facts_of_file(path) if facts["kind"] == kind]


def require_open_process(module: str) -> None:
    """Raise ``AssertionError`` if no foreign code may be imported into this process."""
    if is_closed():
        raise AssertionError(f"{module} must not be imported into this process")

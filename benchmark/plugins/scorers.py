"""Registry of scorers: built in, in installed packages, and in plugin files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmark.pipeline.storage.records import DEFAULT_SCORER
from benchmark.plugins.inspection import plugins_of
from benchmark.plugins.registry import KnownPlugins, variant
from benchmark.plugins.specs import ScorerSpec

__all__ = ["BUILT_IN", "DEFAULT", "ScorerSpec", "plugin_scorers", "scorer_of", "scorers"]

#: Scorer of the paper's tables; its name is omitted from the names of jobs and from records.
DEFAULT = DEFAULT_SCORER

BUILT_IN: dict[str, str] = {DEFAULT: ScorerSpec.target}


def scorers(plugins: Iterable[Path] = ()) -> KnownPlugins[ScorerSpec]:
    """Return all known scorers by name, the default first.

    Parameters
    ----------
    plugins
        Python files that may define scorers.

    Raises
    ------
    ConfigurationError
        If two scorers have the same name, or a plugin file cannot be used.
    """
    return KnownPlugins(ScorerSpec, BUILT_IN, plugins)


def scorer_of(name: str, known: Mapping[str, ScorerSpec]) -> ScorerSpec:
    """Return the scorer for a name, which may have parameters in brackets.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, a value is invalid, or a package is missing.
    """
    spec = variant(name, known)
    spec.create()  # lets the class refuse invalid combinations now
    return spec


def plugin_scorers(path: Path) -> list[ScorerSpec]:
    """Return the scorers in a plugin file; see :func:`benchmark.plugins.inspection.plugins_in`."""
    return plugins_of(ScorerSpec, path)

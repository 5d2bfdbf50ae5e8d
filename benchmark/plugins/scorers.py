"""Names of scorers: built-in ones, those of installed packages, and those of a plugin file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmark.pipeline.storage.records import DEFAULT_SCORER
from benchmark.plugins.inspection import installed, plugins_of
from benchmark.plugins.registry import KnownPlugins, variant
from benchmark.plugins.specs import ScorerSpec

__all__ = ["BUILT_IN", "DEFAULT", "ScorerSpec", "plugin_scorers", "scorer_of", "scorers", "unusable"]

#: Scorer of the tables of the paper. Its name is left out of the names of jobs and of records.
DEFAULT = DEFAULT_SCORER

BUILT_IN: dict[str, str] = {
    DEFAULT: ScorerSpec.target,
    "spherical-harmonics": "retrieval.spherical_harmonics:SphericalHarmonics",
}


def scorers(plugins: Iterable[Path] = ()) -> dict[str, ScorerSpec]:
    """All known scorers by name, the default first.

    Parameters
    ----------
    plugins
        Python files that may define scorers.

    Raises
    ------
    ConfigurationError
        If two scorers have one name, or a plugin file cannot be used.
    """
    return KnownPlugins(ScorerSpec, BUILT_IN, plugins)


def unusable() -> tuple[str, ...]:
    """One line for each installed package with scorers that cannot be used, and are left out of :func:`scorers`."""
    return installed(ScorerSpec, frozenset(BUILT_IN)).news


def scorer_of(name: str, known: Mapping[str, ScorerSpec]) -> ScorerSpec:
    """Return the scorer that a name, with parameters in brackets if need be, stands for.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, a value does not fit, or a package is missing.
    """
    found = variant(name, known)
    found.create()  # a class may refuse parameters by a rule of its own, and had better do so now
    return found


def plugin_scorers(path: Path) -> list[ScorerSpec]:
    """Scorers defined in a plugin file; see :func:`benchmark.plugins.inspection.plugins_in`."""
    return plugins_of(ScorerSpec, path)

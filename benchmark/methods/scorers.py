"""Names of scorers: built-in ones, those of installed packages, and those of a plugin file."""

from __future__ import annotations

import importlib.metadata
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from benchmark.api.scoring import Scorer, ScorerInfo
from benchmark.errors import ConfigurationError
from benchmark.methods.information import problems_of_scorer
from benchmark.methods.loading import classes_of, is_foreign, load_class, make, module_of
from benchmark.parameters.grid import split_name
from benchmark.parameters.values import assignments, format_value, non_default_values, parameter_values
from benchmark.storage.records import DEFAULT_SCORER
from benchmark.system.plugins import unknown

ENTRY_POINTS = "canonical_forms.scorers"

#: Scorer of the tables of the paper. Its name is left out of the names of jobs and of records.
DEFAULT = DEFAULT_SCORER

BUILT_IN: dict[str, str] = {
    DEFAULT: "retrieval.cmbof:CMBOF",
    "spherical-harmonics": "retrieval.spherical_harmonics:SphericalHarmonics",
}

_HINT = "see 'A scorer' in docs/reference/plugins.md"


@dataclass(frozen=True)
class ScorerSpec:
    """A scorer by name, with everything needed to make it again in another process.

    Parameters
    ----------
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or as they are; those that differ from their defaults are kept, normalised.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value does not fit.
    """

    base_name: str = DEFAULT
    target: str = BUILT_IN[DEFAULT]
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.parameters:
            object.__setattr__(self, "parameters", non_default_values(self.load(), self.parameters, self.base_name))

    @property
    def name(self) -> str:
        """Name on the command line, in its one spelling."""
        chosen = ",".join(f"{key}={format_value(value)}" for key, value in self.parameters.items())
        return f"{self.base_name}[{chosen}]" if chosen else self.base_name

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        chosen = ", ".join(f"{key}={format_value(value)}" for key, value in self.parameters.items())
        return f"{self.info.title} ({chosen})" if chosen else self.info.title

    @property
    def module(self) -> str:
        """Module name or plugin path."""
        return module_of(self.target)

    @property
    def is_foreign(self) -> bool:
        """Return whether the scorer comes from a plugin file or an installed package."""
        return is_foreign(self.module)

    @property
    def info(self) -> ScorerInfo:
        """Return what the scorer says about itself."""
        return cast(ScorerInfo, self.load().info)

    def load(self) -> type[Any]:
        """Import and return the class.

        Raises
        ------
        ConfigurationError
            If it cannot be imported or is not a scorer.
        """
        return load_class("scorer", self.base_name, self.target, ScorerInfo, _HINT)

    def create(self) -> Scorer:
        """Make the scorer with its parameters.

        Raises
        ------
        ConfigurationError
            If a package is missing, the class refuses the parameters, or what it makes is no scorer.
        """
        found = self.load()
        if missing := self.missing_packages():
            raise ConfigurationError(
                f"scorer '{self.base_name}' needs {', '.join(missing)}", f"pip install {' '.join(missing)}"
            )
        created = make(found, self.name, self.parameters)
        if not isinstance(created, Scorer):
            raise ConfigurationError(f"{self.target} lacks 'signature' or 'compare'", _HINT)
        return created

    def missing_packages(self) -> tuple[str, ...]:
        """Packages that the scorer declares and that are not installed."""
        return tuple(name for name in self.info.requires if importlib.util.find_spec(name) is None)

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included, normalised."""
        return parameter_values(self.create())


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
    found = {name: ScorerSpec(name, target) for name, target in BUILT_IN.items()}
    installed = (ScorerSpec(p.name, p.value) for p in importlib.metadata.entry_points(group=ENTRY_POINTS))
    for spec in (*installed, *(spec for path in plugins for spec in plugin_scorers(path))):
        if spec.name in found:
            raise ConfigurationError(
                f"two scorers are called '{spec.name}': {found[spec.name].target} and {spec.target}", "rename one"
            )
        found[spec.name] = spec
    return found


def scorer_of(name: str, known: Mapping[str, ScorerSpec]) -> ScorerSpec:
    """Return the scorer that a name, with parameters in brackets if need be, stands for.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, or a value does not fit.
    """
    base, inside = split_name(name) or (name, "")
    if base not in known:
        raise unknown("scorer", base, known)
    spec = ScorerSpec(base, known[base].target, assignments(inside))
    spec.create()  # a class may refuse parameters by a rule of its own, and had better do so now
    return spec


def plugin_scorers(path: Path) -> list[ScorerSpec]:
    """Scorers defined in a plugin file, in the order of the file; none where it defines methods alone.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, or a scorer says of itself what cannot be.
    """
    return [ScorerSpec(name, target) for name, target in classes_of(path, ScorerInfo, problems_of_scorer)]

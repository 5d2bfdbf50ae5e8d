"""A method with its parameters, as it travels between processes: where it is defined, and how it is made."""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from benchmark.api.contracts import Descriptor, Method, MethodInfo
from benchmark.api.scoring import ScorerInfo
from benchmark.datasets.own import data_sets_of
from benchmark.errors import ConfigurationError
from benchmark.methods.information import problems_of
from benchmark.methods.loading import classes_of, is_foreign, load_class, make, module_of
from benchmark.parameters.grid import quoted
from benchmark.parameters.values import format_value, non_default_values, parameter_values
from benchmark.system import fingerprints
from benchmark.system.plugins import import_plugin

_HINT = "see 'Add a method' in the README"


@dataclass(frozen=True)
class MethodSpec:
    """A method by name, with everything needed to make it again in another process.

    Parameters
    ----------
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or as they are; those that differ from their defaults are kept, normalised and in the order
        of the fields, so that two ways to write one method make equal objects.
    named
        Whether somebody asked for this method, by its name or by passing its file.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value does not fit.
    """

    base_name: str
    target: str
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    named: bool = False

    def __post_init__(self) -> None:
        if self.parameters:
            object.__setattr__(self, "parameters", non_default_values(self.load(), self.parameters, self.base_name))

    @property
    def name(self) -> str:
        """Name on the command line, in its one spelling."""
        return f"{self.base_name}[{self._chosen(',')}]" if self.parameters else self.base_name

    def _chosen(self, separator: str) -> str:
        """Parameters as they are written on the command line; a text that would be read as another one is quoted."""
        texts = {
            key: quoted(value) if isinstance(value, str) else format_value(value)
            for key, value in self.parameters.items()
        }
        return separator.join(f"{key}={text}" for key, text in texts.items())

    @property
    def module(self) -> str:
        """Module name or plugin path."""
        return module_of(self.target)

    @property
    def is_foreign(self) -> bool:
        """Return whether the method comes from a plugin file or an installed package."""
        return is_foreign(self.module)

    @property
    def inherited(self) -> tuple[str, ...]:
        """Modules of the suite that its class, made by a decorator or inherited from elsewhere, brings along."""
        modules = dict.fromkeys(base.__module__ for base in inspect.getmro(self.load())[1:])
        return tuple(name for name in modules if name.partition(".")[0] in fingerprints.FIRST_PARTY)

    def load(self) -> type[Any]:
        """Import and return the class.

        Raises
        ------
        ConfigurationError
            If it cannot be imported or is not a method.
        """
        return load_class("method", self.base_name, self.target, MethodInfo, _HINT)

    def create(self) -> Method | Descriptor:
        """Make the method with its parameters.

        Raises
        ------
        ConfigurationError
            If the class refuses them, or what it makes is no method.
        """
        created = make(self.load(), self.name, self.parameters)
        if not isinstance(created, (Method, Descriptor)):
            raise ConfigurationError(f"{self.target} has neither 'canonicalise' nor 'describe' and 'distances'", _HINT)
        return created

    @property
    def info(self) -> MethodInfo:
        """Return what the method says about itself."""
        return cast(MethodInfo, self.load().info)

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        return f"{self.info.title} ({self._chosen(', ')})" if self.parameters else self.info.title

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included, normalised."""
        return parameter_values(self.create())

    @property
    def learns(self) -> bool:
        """Return whether the method is a learner; see :class:`benchmark.api.learning.Learner`."""
        found = self.load()
        return all(hasattr(found, name) for name in ("train", "load", "model_name", "split"))

    @property
    def describes(self) -> bool:
        """Return whether the method is a descriptor, which compares shapes without a form and so without a scorer."""
        found = self.load()
        return not hasattr(found, "canonicalise") and hasattr(found, "describe")

    def with_parameters(self, parameters: Mapping[str, Any]) -> MethodSpec:
        """Return the method with further parameters, as text or as they are."""
        return dataclasses.replace(self, parameters={**self.parameters, **parameters})

    def with_parameter(self, name: str, value: Any) -> MethodSpec:
        """Return the method with one more parameter."""
        return self.with_parameters({name: value})

    def without_parameter(self, name: str) -> MethodSpec:
        """Return the method with the default of one parameter."""
        others = {key: value for key, value in self.parameters.items() if key != name}
        return dataclasses.replace(self, parameters=others)

    def missing_packages(self) -> tuple[str, ...]:
        """Packages that the method declares and that are not installed."""
        return tuple(name for name in self.info.requires if importlib.util.find_spec(name) is None)


def plugin_methods(path: Path) -> list[MethodSpec]:
    """Methods defined in a plugin file, in the order of the file; none where it brings something else.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, defines nothing, or a method says of itself what cannot be.
    """
    module = import_plugin(str(path.resolve()))
    specs = [MethodSpec(name, target) for name, target in classes_of(path, MethodInfo, problems_of)]
    has_scorers = any(isinstance(getattr(value, "info", None), ScorerInfo) for value in vars(module).values())
    if not (specs or has_scorers or data_sets_of([path])):
        raise ConfigurationError(
            f"plugin {path} defines no method, no scorer and no data set",
            "give a class an 'info' that is a MethodInfo, a ScorerInfo or a DatasetInfo, or use @canonical_form",
        )
    return specs

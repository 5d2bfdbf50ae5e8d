"""A method or scorer by name, with everything needed to create it in another process."""

from __future__ import annotations

import importlib.util
import inspect
import secrets
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from types import FunctionType
from typing import Any, Literal, Self

from benchmark.api.contracts import Descriptor, Method, MethodInfo, canonical_form
from benchmark.api.parameters import (
    declared_parameters,
    format_value,
    non_default_values,
    parameter_values,
)
from benchmark.api.scoring import Scorer, ScorerInfo
from benchmark.code_digest import FIRST_PARTY, code_digest, code_of, is_installed, plugin_file
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.reads import watching
from benchmark.registry.modules import load_module, named_files
from benchmark.registry.names import quoted
from benchmark.text import brief

Kind = Literal["method", "scorer"]

#: Process of the objects of a Python program: the program itself.
THIS_PROCESS = "this process"

#: For each kind of class: the type of its ``info``, what an object must be, and what it lacks
#: otherwise.
_CONTRACTS: Mapping[Kind, tuple[type[Any], tuple[type[Any], ...], str]] = {
    "method": (
        MethodInfo,
        (Method, Descriptor),
        "neither 'canonicalise' nor 'describe' and 'distances'",
    ),
    "scorer": (ScorerInfo, (Scorer,), "no 'signature' or no 'compare'"),
}


@dataclass(frozen=True)
class Component:
    """A method, descriptor, learner or scorer.

    Parameters
    ----------
    kind
        ``"method"`` (descriptors and learners included) or ``"scorer"``.
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or values; only values other than the defaults are stored, normalised and
        in the order of the fields, so that equal components are equal objects however they are
        written.
    given, state
        The object itself, if a Python program passed one, and a text that identifies it.
    is_unknown
        Whether the object may depend on anything: it stays in its process, and is never known
        again.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value is invalid.
    """

    kind: Kind
    base_name: str
    target: str
    parameters: Mapping[str, Any] = field(default_factory=dict, compare=False)
    given: Any = field(default=None, compare=False, repr=False)
    state: str = ""
    is_unknown: bool = False
    _values: str = field(init=False, repr=False)  # 1, 1.0 and True are equal

    def __post_init__(self) -> None:
        if self.parameters and self.given is None:
            chosen = non_default_values(self.load(), self.parameters, self.base_name)
            object.__setattr__(self, "parameters", chosen)
        object.__setattr__(self, "_values", repr(dict(self.parameters)))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the object of a program out where another process gets the description."""
        return vars(self) | ({"given": None, "parameters": {}} if self.is_unknown else {})

    @property
    def process(self) -> str:
        """Whose process it runs in: "" for the suite, the class of a plugin, or that of the program itself."""
        if self.is_unknown:
            return THIS_PROCESS
        return "" if self.of_suite else self.target

    @property
    def name(self) -> str:
        """Name on the command line, in its normal form."""
        chosen = self._chosen(",")
        return f"{self.base_name}[{chosen}]" if chosen else self.base_name

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        chosen = self._chosen(", ")
        return f"{self.info.title} ({chosen})" if chosen else str(self.info.title)

    def _chosen(self, separator: str) -> str:
        texts = {
            key: quoted(v) if isinstance(v, str) else format_value(v)
            for key, v in self.parameters.items()
        }
        return separator.join(f"{key}={text}" for key, text in texts.items())

    @property
    def defaults(self) -> dict[str, Any]:
        """Parameters that have their defaults."""
        every = declared_parameters(self.load()).items()
        return {
            name: value
            for name, (_, value) in every
            if name not in self.parameters and value is not MISSING
        }

    @property
    def plugin(self) -> Path | None:
        """Path of its plugin file; None for a component of the suite."""
        return plugin_file(self.target)

    @property
    def of_suite(self) -> bool:
        """Whether it is part of the suite."""
        return self.target.partition(":")[0].partition(".")[0] in FIRST_PARTY

    @property
    def info(self) -> Any:
        """Its description: ``MethodInfo`` or ``ScorerInfo``."""
        return (self.load() if self.given is None else self.given).info

    @property
    def files(self) -> tuple[str, ...]:
        """Other files of its code: those that any class of a plugin file names, since they share its variables."""
        return named_files(load_module(self.target)) if self.plugin else self.info.files

    @property
    def summary(self) -> str:
        """Summary in one line."""
        return brief(self.info.summary or (inspect.getdoc(self.load()) or "").partition("\n")[0])

    @property
    def learns(self) -> bool:
        """Whether it is a learner; see :class:`benchmark.api.learning.Learner`."""
        return all(hasattr(self.load(), name) for name in ("train", "load", "model_name", "split"))

    @property
    def describes(self) -> bool:
        """Whether it is a descriptor, which compares shapes without forms and without a scorer."""
        return not hasattr(self.load(), "canonicalise") and hasattr(self.load(), "describe")

    def load(self) -> Any:
        """Import and return the class.

        Raises
        ------
        ConfigurationError
            If that fails, or the class has no ``info``.
        """
        if self.given is not None:
            return type(self.given)
        attribute = self.target.rpartition(":")[2]
        found = getattr(load_module(self.target), attribute, None)
        if found is None:
            raise ConfigurationError(
                f"{self.target.rpartition(':')[0]} has no '{attribute}'", "correct the name"
            )
        info_type = _CONTRACTS[self.kind][0]
        if not isinstance(getattr(found, "info", None), info_type):
            raise ConfigurationError(
                f"{self.target} has no 'info: ClassVar[{info_type.__name__}]'", "add one"
            )
        return found

    def create(self) -> Any:
        """Create an object with the parameters.

        Raises
        ------
        ConfigurationError
            If a package is missing, the class refuses the parameters, or the object lacks a method.
        """
        if self.given is not None:
            return self.given
        if missing := self.missing_packages():
            problem = f"{self.kind} '{self.base_name}' needs {', '.join(missing)}"
            raise ConfigurationError(problem, f"pip install {' '.join(missing)}")
        try:
            created = self.load()(**self.parameters)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            hint = (
                "choose other parameters"
                if self.parameters
                else "give every parameter a valid default"
            )
            raise ConfigurationError(
                f"{self.name} cannot be created: {locate(error)}", hint
            ) from error
        _, contract, lacking = _CONTRACTS[self.kind]
        if not isinstance(created, contract):
            raise ConfigurationError(
                f"{self.target} has {lacking}", "add it: see docs/reference/plugins.md"
            )
        return created

    def missing_packages(self) -> tuple[str, ...]:
        """Return the declared packages that are not installed."""
        requires = getattr(self.info, "requires", ())
        return tuple(name for name in requires if importlib.util.find_spec(name) is None)

    def in_this_process(self) -> Self:
        """Return it as an object of this process, where it can be debugged; as it is if it is of the suite."""
        if self.of_suite or self.given is not None or self.missing_packages():
            return self
        return replace(self, given=self.create(), state=secrets.token_hex(8), is_unknown=True)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """Return the same component with additional parameters, as text or values; raise for a given object."""
        if self.given is not None:
            raise ConfigurationError(
                f"'{self.name}' is an object with parameters of its own", "create another one"
            )
        return replace(self, parameters={**self.parameters, **parameters})

    def code(self) -> dict[str, str]:
        """Return what its code consists of, with ``info.files``; see :func:`benchmark.code_digest.code_of`."""
        of_object = {"its code": self.state} if self.state else {}
        return of_object | ({} if self.is_unknown else code_of(self.target, self.files))

    def key(self) -> dict[str, Any]:
        """Return what determines its results; the path of a plugin file does not count."""
        module, _, attribute = self.target.rpartition(":")
        return {
            "target": attribute if self.plugin else f"{module}:{attribute}",
            "parameters": dict(self.parameters),
            "code": "" if self.is_unknown else code_digest(self.target, self.files),
            "state": self.state,
        }


def watching_component(
    component: Component, allowed: Iterable[Path] = ()
) -> AbstractContextManager[object]:
    """Return the context in which the code of a plugin is watched; see :func:`benchmark.reads.watching`."""
    if component.is_unknown or not component.plugin:
        return nullcontext()
    return watching(
        component.target, [*(component.plugin.parent / name for name in component.files), *allowed]
    )


def component_of(value: Any) -> Component:
    """Return the component for a method or scorer, its class, or a function from a shape to positions.

    Raises
    ------
    ConfigurationError
        If it is nothing of these kinds.
    """
    if isinstance(value, Component):
        return value
    if isinstance(value, FunctionType) and value.__name__ != "<lambda>":
        title = value.__name__.replace("_", " ").strip()
        value = canonical_form(name=title.replace(" ", "-").lower(), title=title.capitalize())(
            value
        )
    try:
        value = value() if isinstance(value, type) else value
    except Exception as error:
        raise ConfigurationError(
            f"{value} cannot be created: {locate(error)}", "pass an object of it"
        ) from error
    info, cls = getattr(value, "info", None), type(value)
    kind: Kind = "scorer" if isinstance(info, ScorerInfo) else "method"
    info_type, contract, lacking = _CONTRACTS[kind]
    if not (isinstance(value, contract) and isinstance(info, info_type)):
        problem = (
            f"an object of type {cls.__name__} is no method or scorer: it has {lacking}, or no info"
        )
        raise ConfigurationError(
            problem, "pass a function with a name or a dataclass: see docs/reference/plugins.md"
        )
    parameters, attributes = parameter_values(value), getattr(value, "__dict__", None)
    chosen, target = non_default_values(cls, parameters), f"{cls.__module__}:{cls.__qualname__}"
    is_plain = attributes == parameters
    if hasattr(value, "train") and any(
        of for name, of in (attributes or {}).items() if name not in parameters
    ):
        raise ConfigurationError(
            f"'{info.name}' has a model already, and a run looks for it", "pass it without one"
        )
    if is_plain and is_installed(cls.__module__ or "__main__"):
        return Component(kind, str(info.name), target, chosen)  # its name says all
    # An object of the user depends on whatever the program may change, so it is never known again.
    return Component(
        kind, str(info.name), target, chosen, value, secrets.token_hex(8), is_unknown=True
    )

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
from typing import Any, Literal, NamedTuple, Self

from benchmark.api.contracts import Descriptor, Method, MethodInfo, canonical_form
from benchmark.api.parameters import (
    declared_parameters,
    format_value,
    non_default_values,
    parameter_values,
    plain_value,
    quoted,
    read_back,
)
from benchmark.api.scoring import Scorer, ScorerInfo
from benchmark.code_digest import FIRST_PARTY, code_digest, code_of, is_installed, plugin_file
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.reads import watching
from benchmark.registry.modules import load_module, named_files
from benchmark.text import brief

Kind = Literal["method", "scorer"]

#: Process of the objects of a Python program: the program itself.
THIS_PROCESS = "this process"


class _Contract(NamedTuple):
    """What a component of a kind must be.

    Parameters
    ----------
    info_type
        Type of its ``info``.
    protocols
        Types of which an object must be one.
    lacking
        What an object of none of them lacks.
    """

    info_type: type[Any]
    protocols: tuple[type[Any], ...]
    lacking: str


_CONTRACTS: Mapping[Kind, _Contract] = {
    "method": _Contract(
        MethodInfo,
        (Method, Descriptor),
        "neither 'canonicalise' nor 'describe' and 'distances'",
    ),
    "scorer": _Contract(ScorerInfo, (Scorer,), "no 'signature' or no 'compare'"),
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
        written. What is stored are plain values: another process cannot read objects of a plugin.
    given, state
        The object itself, if a Python program passed one, and a text that identifies it.
    is_unknown
        Whether the object may depend on anything: it stays in its process, and is never known
        again.
    is_fixed
        Whether parameters were named, be it with their defaults: ``learned[training_seed=0]`` is
        this training alone, and ``learned`` stands for all of its seeds.

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
    is_fixed: bool = field(default=False, compare=False, repr=False)
    _values: str = field(init=False, repr=False)  # 1, 1.0 and True are equal

    def __post_init__(self) -> None:
        if self.parameters or self.given is not None:
            object.__setattr__(self, "is_fixed", True)
        if self.parameters and self.given is None:
            chosen = non_default_values(self.load(), self.parameters, self.base_name)
            object.__setattr__(self, "parameters", chosen)
        object.__setattr__(self, "_values", repr(dict(self.parameters)))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the object of a program out where another process gets the description."""
        state = dict(vars(self))
        if self.is_unknown:
            state |= {"given": None, "parameters": {}}
        return state

    @property
    def process(self) -> str:
        """Whose process it runs in.

        "" for the suite, the class of a plugin, or that of the program itself.
        """
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
        """Return the parameters that differ from their defaults as text."""
        texts = []
        for name, value in self.parameters.items():
            text = quoted(value) if isinstance(value, str) else format_value(value)
            texts.append(f"{name}={text}")
        return separator.join(texts)

    @property
    def defaults(self) -> dict[str, Any]:
        """Parameters that have their defaults."""
        return {
            name: plain_value(default)
            for name, (_, default) in declared_parameters(self.load()).items()
            if name not in self.parameters and default is not MISSING
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
        """Other files of its code.

        Those that any class of a plugin file names, since they share its variables.
        """
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
        """Import and return the class of this component.

        Raises
        ------
        ConfigurationError
            If it cannot be imported, or has no ``info``.
        """
        if self.given is not None:  # an object of a Python program
            return type(self.given)
        module, _, attribute = self.target.rpartition(":")
        cls = getattr(load_module(self.target), attribute, None)
        if cls is None:
            raise ConfigurationError(f"{module} has no '{attribute}'", "correct the name")
        info_type = _CONTRACTS[self.kind].info_type
        if not isinstance(getattr(cls, "info", None), info_type):
            problem = f"{self.target} has no 'info: ClassVar[{info_type.__name__}]'"
            raise ConfigurationError(problem, "add one")
        return cls

    def create(self) -> Any:
        """Return an object of the class, with the parameters of this component.

        Raises
        ------
        ConfigurationError
            If a package is missing, the class refuses the parameters, or the object lacks a method.
        """
        if self.given is not None:  # an object of a Python program
            return self.given
        missing = self.missing_packages()
        if missing:
            problem = f"{self.kind} '{self.base_name}' needs {', '.join(missing)}"
            raise ConfigurationError(problem, f"pip install {' '.join(missing)}")
        parameters = read_back(self.load(), self.parameters, self.base_name)
        try:
            created = self.load()(**parameters)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:  # code of a user may raise anything
            hint = "give every parameter a valid default"
            if self.parameters:
                hint = "choose other parameters"
            problem = f"{self.name} cannot be created: {locate(error)}"
            raise ConfigurationError(problem, hint) from error
        contract = _CONTRACTS[self.kind]
        if not isinstance(created, contract.protocols):
            problem = f"{self.target} has {contract.lacking}"
            raise ConfigurationError(problem, "add it: see docs/reference/plugins.md")
        return created

    def missing_packages(self) -> tuple[str, ...]:
        """Return the declared packages that are not installed."""
        requires = getattr(self.info, "requires", ())
        return tuple(name for name in requires if not _is_importable(name))

    def in_this_process(self) -> Self:
        """Return it as an object of this process, where it can be debugged.

        What is of the suite is returned as it is.
        """
        if self.of_suite or self.given is not None or self.missing_packages():
            return self
        return replace(self, given=self.create(), state=secrets.token_hex(8), is_unknown=True)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """Return the same component with additional parameters, as text or values.

        Raises
        ------
        ConfigurationError
            If it is an object of a Python program, which has parameters already.
        """
        if self.given is not None:
            problem = f"'{self.name}' is an object with parameters of its own"
            raise ConfigurationError(problem, "create another one")
        return replace(self, parameters={**self.parameters, **parameters})

    def code(self) -> dict[str, str]:
        """Return what its code consists of, with ``info.files``.

        See :func:`benchmark.code_digest.code_of`.
        """
        code = {"its code": self.state} if self.state else {}
        if not self.is_unknown:
            code |= code_of(self.target, self.files)
        return code

    def key(self, without: Iterable[str] = ()) -> dict[str, Any]:
        """Return what determines its results; the path of a plugin file does not count.

        Parameters
        ----------
        without
            Names of modules whose code does not count.
        """
        module, _, attribute = self.target.rpartition(":")
        return {
            "target": attribute if self.plugin else f"{module}:{attribute}",
            "parameters": dict(self.parameters),
            "code": "" if self.is_unknown else code_digest(self.target, self.files, without),
            "state": self.state,
        }

    def key_of_signatures(self) -> dict[str, Any]:
        """Return what determines the signatures of a scorer: all but what compares them."""
        return self.key(without=self.info.comparing)


def _is_importable(name: str) -> bool:
    """Return whether there is a package or a module of it, such as ``"sksparse.cholmod"``."""
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):  # without the package of a module
        return False


def watching_component(
    component: Component, allowed: Iterable[Path] = ()
) -> AbstractContextManager[object]:
    """Return the context in which the code of a plugin is watched.

    See :func:`benchmark.reads.watching`.

    Parameters
    ----------
    component
        A component.
    allowed
        Files and folders that it may read beside those that it declares.
    """
    if component.is_unknown or not component.plugin:
        return nullcontext()
    folder = component.plugin.parent
    declared = [folder / name for name in component.files]
    return watching(component.target, [*declared, *allowed])


def component_of(value: Any) -> Component:
    """Return the component for a method or scorer that a Python program passes.

    Parameters
    ----------
    value
        An object of a method or scorer, its class, or a function from a shape to positions.

    Returns
    -------
    Component
        A method of the suite or of an installed package is identified by its name and parameters,
        so its stored results are found again. Any other object gets a random identifier.

    Raises
    ------
    ConfigurationError
        If the value is no method or scorer, or is a network with a model already loaded.
    """
    if isinstance(value, Component):
        return value
    value = _object_of(value)
    kind = _kind_of_object(value)
    name = str(value.info.name)
    cls = type(value)
    target = f"{cls.__module__}:{cls.__qualname__}"
    parameters = parameter_values(value)
    chosen = non_default_values(cls, parameters)
    attributes = getattr(value, "__dict__", None)

    learns = hasattr(value, "train")
    if learns and _has_more_than(parameters, attributes or {}):
        problem = f"'{value.info.name}' has a model already, and a run looks for it"
        raise ConfigurationError(problem, "pass it without one")

    has_only_parameters = attributes == parameters
    if has_only_parameters and is_installed(cls.__module__ or "__main__"):
        return Component(kind, name, target, chosen)
    # The results of any other object depend on whatever the program may change, so that no stored
    # result may be taken for its own.
    return Component(
        kind,
        name,
        target,
        chosen,
        given=value,
        state=secrets.token_hex(8),
        is_unknown=True,
    )


def _kind_of_object(value: Any) -> Kind:
    """Return ``"method"`` or ``"scorer"``, depending on which of the two an object is.

    Raises
    ------
    ConfigurationError
        If it is neither: it lacks a method, or its ``info``.
    """
    info = getattr(value, "info", None)
    kind: Kind = "scorer" if isinstance(info, ScorerInfo) else "method"
    contract = _CONTRACTS[kind]
    if isinstance(value, contract.protocols) and isinstance(info, contract.info_type):
        return kind
    problem = (
        f"an object of type {type(value).__name__} is no method or scorer: "
        f"it has {contract.lacking}, or no info"
    )
    hint = "pass a function with a name or a dataclass: see docs/reference/plugins.md"
    raise ConfigurationError(problem, hint)


def _object_of(value: Any) -> Any:
    """Return an object for a function or a class; return any other object itself.

    A function from a shape to positions becomes a method with the name of the function.

    Raises
    ------
    ConfigurationError
        If a class cannot be created without arguments.
    """
    is_named_function = isinstance(value, FunctionType) and value.__name__ != "<lambda>"
    if is_named_function:
        title = value.__name__.replace("_", " ").strip()
        name = title.replace(" ", "-").lower()
        value = canonical_form(name=name, title=title.capitalize())(value)
    if not isinstance(value, type):
        return value
    try:
        return value()
    except Exception as error:
        problem = f"{value} cannot be created: {locate(error)}"
        raise ConfigurationError(problem, "pass an object of it") from error


def _has_more_than(parameters: Mapping[str, Any], attributes: Mapping[str, Any]) -> bool:
    """Return whether an object has attributes that are not empty beside its parameters."""
    return any(value for name, value in attributes.items() if name not in parameters)

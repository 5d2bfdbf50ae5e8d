"""Specifications of plugins, as passed between processes: definition, parameters and facts.

Methods, scorers and data sets of the suite, of installed packages and of plugin files have the same specifications. A
closed process gets the facts and results of a plugin from the plugin's own process.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar, cast, get_type_hints

import msgspec

from benchmark.api.contracts import Descriptor, Method, MethodInfo
from benchmark.api.datasets import DatasetInfo, Entry, ListsShapes
from benchmark.api.parameters import format_value, non_default_values, parameter_values
from benchmark.api.scoring import Scorer, ScorerInfo
from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, one_line
from benchmark.execution.processes.process import is_child, one_of_us
from benchmark.pipeline.storage.keys import plain
from benchmark.pipeline.storage.records import DEFAULT_SCORER
from benchmark.plugins import is_closed
from benchmark.plugins.modules import import_module, sources_of
from benchmark.plugins.output_checks import problems_of_entries, problems_of_learner
from benchmark.plugins.parameters import ParameterText, described, quoted
from benchmark.plugins.remote import Answer, OpenedDataset, Remote, answer
from benchmark.source_code import FIRST_PARTY

Info = TypeVar("Info", MethodInfo, ScorerInfo, DatasetInfo)
Instance = TypeVar("Instance")
Value = TypeVar("Value")


class Fact(Generic[Value]):
    """A fact about a plugin, computed once if the plugin may be imported here, otherwise reported by its process."""

    def __init__(self, work_out: Callable[[Any], Value]) -> None:
        self._work_out, self._name, self.__doc__ = work_out, work_out.__name__, work_out.__doc__

    def __get__(self, spec: PluginSpec[Any, Any] | None, owner: type[Any]) -> Value:
        if spec is None:
            return self  # type: ignore[return-value]
        if spec.is_elsewhere:
            kind = get_type_hints(self._work_out)["return"]
            value = msgspec.convert(spec.remote.facts[self._name], kind, dec_hook=lambda path, text: path(text))
        else:
            value = self._work_out(spec)
        vars(spec)[self._name] = value  # takes precedence over this descriptor from now on
        return cast(Value, value)


@dataclass(frozen=True)
class PluginSpec(Generic[Info, Instance]):
    """A method, a scorer or a data set by name, with everything needed to create it in another process.

    Parameters
    ----------
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or values; only values other than the defaults are stored, normalised and in the order of the
        fields, so that equal plugins are equal objects however they are written.
    named
        Whether the user selected it, by name or by passing its file.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value is invalid.
    """

    #: Kind in messages; the group of entry points in installed packages is ``canonical_forms.KINDs``.
    kind: ClassVar[str]
    #: Type of its description.
    info_type: ClassVar[type[Any]]
    #: Protocols, of which an object must implement one; message for a violation, and hint.
    contracts: ClassVar[tuple[type[Any], ...]]
    lacking: ClassVar[str]
    hint: ClassVar[str]

    base_name: str
    target: str
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    named: bool = False

    def __post_init__(self) -> None:
        if not self.parameters or (self.is_elsewhere and is_child()):  # already inspected by the parent process
            return
        if self.is_elsewhere:
            facts = self.remote.facts["chosen"]
            chosen = {name: tuple(value) if isinstance(value, list) else value for name, value in facts.items()}
        else:
            chosen = non_default_values(self.load(), self.parameters, self.base_name)
        object.__setattr__(self, "parameters", chosen)

    @property
    def name(self) -> str:
        """Name on the command line, in its normal form."""
        chosen = self._chosen(",")
        return f"{self.base_name}[{chosen}]" if chosen else self.base_name

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        chosen = self._chosen(", ")
        return f"{self.info.title} ({chosen})" if chosen else self.info.title

    def _chosen(self, separator: str) -> str:
        """Return the parameters as on the command line; ambiguous text is quoted."""
        texts = [quoted(v) if isinstance(v, str) else format_value(v) for v in self.parameters.values()]
        return separator.join(f"{key}={text}" for key, text in zip(self.parameters, texts, strict=True))

    @property
    def module(self) -> str:
        """Module name or plugin path."""
        return self.target.rpartition(":")[0]

    @property
    def is_foreign(self) -> bool:
        """Whether it comes from a plugin file or an installed package."""
        return self.module.partition(".")[0] not in FIRST_PARTY

    @property
    def is_elsewhere(self) -> bool:
        """Whether this process must not import it."""
        return self.is_foreign and is_closed()

    @property
    def remote(self) -> Remote:
        """The plugin in its own process."""
        return Remote(serve, self.kind, self.base_name, self.target, self.parameters)

    @property
    def info(self) -> Info:
        """Description of the plugin."""
        if self.is_elsewhere:
            return cast(Info, msgspec.convert(self.remote.facts["info"], self.info_type))
        return cast(Info, self.load().info)

    @Fact
    def summary(self) -> str:
        """Summary in one line."""
        return self.info.summary or (inspect.getdoc(self.load()) or "").partition("\n")[0]

    @Fact
    def parameter_texts(self) -> list[ParameterText]:
        """Descriptions of the parameters."""
        return described(self.load())

    @Fact
    def all_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included, normalised; empty if packages are missing."""
        return {} if self.missing_packages() else parameter_values(self.create())

    @Fact
    def sources(self) -> dict[str, str]:
        """Result of :func:`benchmark.plugins.modules.sources_of`; empty for plugins of the suite."""
        self.load()
        return sources_of(self.module, getattr(self.info, "files", ())) if self.is_foreign else {}

    @property
    def facts(self) -> dict[str, Any]:
        """All facts as plain values for other processes.

        Raises
        ------
        ConfigurationError
            If it cannot be created with its parameters, or described in plain values.
        """
        names = {name for cls in type(self).__mro__ for name, value in vars(cls).items() if isinstance(value, Fact)}
        facts = {name: getattr(self, name) for name in names - {"all_parameters"}} | {"info": self.info}
        try:
            parameters = plain({"chosen": self.parameters, "all_parameters": self.all_parameters})
        except (TypeError, ValueError) as error:
            raise ConfigurationError(
                f"parameters of {self.module}, {self.name} cannot be written as JSON ({error})",
                "use numbers, strings and tuples of them",
            ) from error
        return {"kind": self.kind, "target": self.target, **msgspec.to_builtins(facts, enc_hook=str), **parameters}

    def load(self) -> type[Any]:
        """Import and return the class; raise ``ConfigurationError`` if that fails or its description is invalid."""
        module = import_module(self.module, f"{self.kind} '{self.base_name}'")
        cls = getattr(module, attribute := self.target.rpartition(":")[2], None)
        if cls is None:
            raise ConfigurationError(f"{self.module} has no '{attribute}'", "correct the entry point")
        if not isinstance(getattr(cls, "info", None), self.info_type):
            raise ConfigurationError(f"{self.target} has no 'info: ClassVar[{self.info_type.__name__}]'", self.hint)
        return cast(type[Any], cls)

    def create(self) -> Instance:
        """Create an object with the parameters.

        Raises
        ------
        ConfigurationError
            If the class refuses them, or the object does not implement the protocol.
        """
        if self.is_elsewhere:
            return cast(Instance, self.remote.stand_in(self))
        cls = self.load()
        try:
            with one_of_us():
                created = cls(**self.parameters)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigurationError(
                f"{self.name} cannot be created: {one_line(error)}",
                "choose other parameters" if self.parameters else "give every parameter a valid default",
            ) from error
        if not isinstance(created, self.contracts):
            raise ConfigurationError(f"{self.target} {self.lacking}", self.hint)
        return cast(Instance, created)

    def key_parameters(self) -> dict[str, Any]:
        """Return parameters for keys, without defaults for plugins of the suite, whose golden results include them."""
        return dict(self.all_parameters) if self.is_foreign else dict(self.parameters)

    def missing_packages(self) -> tuple[str, ...]:
        """Return the declared packages that are not installed."""
        requires = getattr(self.info, "requires", ())
        return tuple(name for name in requires if importlib.util.find_spec(name) is None)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """Return the same plugin with additional parameters, as text or values."""
        return dataclasses.replace(self, parameters={**self.parameters, **parameters})


@dataclass(frozen=True)
class LearnerFacts:
    """Models of a learner; see :class:`benchmark.api.learning.Learner`."""

    model_name: str
    split: str
    shipped_models: Path
    model_folder: Path | None


@dataclass(frozen=True)
class MethodSpec(PluginSpec[MethodInfo, Method | Descriptor]):
    """A method, a descriptor or a learner by name."""

    kind = "method"
    info_type = MethodInfo
    contracts = (Method, Descriptor)
    lacking = "has neither 'canonicalise' nor 'describe' and 'distances'"
    hint = "see 'Add a method' in the README"

    @Fact
    def learns(self) -> bool:
        """Whether the method is a learner; see :class:`benchmark.api.learning.Learner`."""
        return all(hasattr(self.load(), name) for name in ("train", "load", "model_name", "split"))

    @Fact
    def describes(self) -> bool:
        """Whether the method is a descriptor, which compares shapes without forms and without a scorer."""
        return not hasattr(self.load(), "canonicalise") and hasattr(self.load(), "describe")

    @Fact
    def split(self) -> str:
        """Training data of a learner, see :class:`benchmark.api.learning.Learner`; "" for any other method."""
        return str(getattr(self.load(), "split", ""))

    @Fact
    def learner(self) -> LearnerFacts | None:
        """Facts of a learner; None for any other method, or if packages are missing."""
        if not self.learns or self.missing_packages():
            return None
        learner: Any = self.create()
        for problem, hint in problems_of_learner(learner):
            raise ConfigurationError(f"{self.module}, {self.name}: {problem}", hint)
        folder = getattr(learner, "model_folder", None)
        folder = folder if isinstance(folder, Path) else None
        return LearnerFacts(learner.model_name, learner.split, learner.shipped_models, folder)


@dataclass(frozen=True)
class ScorerSpec(PluginSpec[ScorerInfo, Scorer]):
    """A scorer by name, by default that of the paper's tables."""

    kind = "scorer"
    info_type = ScorerInfo
    contracts = (Scorer,)
    lacking = "lacks 'signature' or 'compare'"
    hint = "see 'A scorer' in docs/reference/plugins.md"

    base_name: str = DEFAULT_SCORER
    target: str = "retrieval.cmbof:CMBOF"

    def create(self) -> Scorer:
        """Create the scorer; raise ``ConfigurationError`` also if a package is missing."""
        if missing := self.missing_packages():
            raise ConfigurationError(
                f"scorer '{self.base_name}' needs {', '.join(missing)}", f"pip install {' '.join(missing)}"
            )
        return super().create()


@dataclass(frozen=True)
class DatasetSpec(PluginSpec[DatasetInfo, ListsShapes]):
    """A data set of a plugin file."""

    kind = "data set"
    info_type = DatasetInfo
    contracts = (ListsShapes,)
    lacking = "has no 'entries'"
    hint = "write a method that lists its shapes"

    @cached_property
    def opened(self) -> OpenedDataset:
        """The data set with its shapes; raises ``DatasetError`` if they are not listed correctly."""
        created = self.create()
        try:
            entries = tuple(created.entries())
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            who = f"{self.module}, {self.target.rpartition(':')[2]}"
            raise DatasetError(f"{who} cannot be opened: {one_line(error)}", "correct the file") from error
        for problem, hint in problems_of_entries(entries):
            raise DatasetError(f"data set '{created.info.name}' of {self.module}: {problem}", hint)
        return OpenedDataset(created, entries)

    @Fact
    def entries(self) -> tuple[Entry, ...]:
        """Its shapes."""
        return self.opened.entries

    @Fact
    def parameters_text(self) -> str:
        """Parameters as Python source."""
        return repr(parameter_values(self.opened.dataset))

    @Fact
    def offers(self) -> tuple[str, ...]:
        """Optional members that the data set defines."""
        return tuple(name for name in ("load", "camera", "recipe") if hasattr(self.opened.dataset, name))

    def ask(self, work: str, identifier: str) -> Answer:
        """Return a result of the data set for a shape."""
        if self.is_elsewhere:
            return self.remote.request(work, {"identifier": identifier})
        return self.opened.ask(work, identifier)


#: Kinds of plugins in plugin files.
KINDS: Mapping[str, type[PluginSpec[Any, Any]]] = {spec.kind: spec for spec in (MethodSpec, ScorerSpec, DatasetSpec)}


def serve(facts: Mapping[str, Any], arrays: Arrays, _: object) -> Answer:
    """Answer a request in the process of the plugin."""
    names = facts["kind"], facts["base_name"], facts["target"], json.dumps(facts["parameters"])
    if facts["work"] == "facts":
        return _spec(*names).facts, {}
    return answer(_created(*names, facts.get("model", "")), facts, arrays)


@cache
def _spec(kind: str, base_name: str, target: str, parameters: str) -> PluginSpec[Any, Any]:
    return KINDS[kind](base_name, target, json.loads(parameters))


@cache
def _created(kind: str, base_name: str, target: str, parameters: str, model: str) -> Any:
    spec = _spec(kind, base_name, target, parameters)
    created: Any = spec.opened if isinstance(spec, DatasetSpec) else spec.create()
    return created.load(Path(model)) if model else created

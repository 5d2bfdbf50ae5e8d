"""Plugins by name, as they travel between processes: where a method or a scorer is defined, and how it is made."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar, cast, get_args, get_type_hints

import msgspec

from benchmark.api.contracts import Descriptor, Input, Method, MethodInfo
from benchmark.api.parameters import format_value, non_default_values, parameter_values
from benchmark.api.scoring import Scorer, ScorerInfo
from benchmark.datasets.own import data_sets_of
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.execution.processes.process import adopt, one_of_us
from benchmark.pipeline.storage.keys import plain
from benchmark.pipeline.storage.records import DEFAULT_SCORER
from benchmark.plugins.closing import facts_of_file, is_closed, reached, require_open_process
from benchmark.plugins.modules import classes_of, import_plugin, sources_of
from benchmark.plugins.parameters import ParameterText, described, quoted
from benchmark.source_code import FIRST_PARTY
from benchmark.text import LONGEST_NAME, RESERVED, is_name

Info = TypeVar("Info", MethodInfo, ScorerInfo)
Made = TypeVar("Made")


@dataclass(frozen=True)
class PluginSpec(Generic[Info, Made]):
    """A method or a scorer by name, with everything needed to make it again in another process.

    A process that imports no plugins asks the process of the plugin for the facts, and lets it do the work.

    Parameters
    ----------
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or as they are; those that differ from their defaults are kept, normalised and in the order
        of the fields, so that two ways to write one plugin make equal objects.
    named
        Whether somebody asked for it, by its name or by passing its file.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value does not fit.
    """

    #: What messages call it; the group of its entry points in installed packages is ``canonical_forms.KINDs``.
    kind: ClassVar[str]
    #: Type of what it says about itself.
    info_type: ClassVar[type[Any]]
    #: Protocols of which what is made keeps one, what it lacks otherwise, and where to read of it.
    contracts: ClassVar[tuple[type[Any], ...]]
    lacking: ClassVar[str]
    hint: ClassVar[str]

    base_name: str
    target: str
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    named: bool = False

    def __post_init__(self) -> None:
        if self.parameters:
            if remote := self._remote:
                chosen = remote.chosen(self.parameters)
            else:
                chosen = non_default_values(self.load(), self.parameters, self.base_name)
            object.__setattr__(self, "parameters", chosen)

    @property
    def name(self) -> str:
        """Name on the command line, in its one spelling."""
        chosen = self._chosen(",")
        return f"{self.base_name}[{chosen}]" if chosen else self.base_name

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        chosen = self._chosen(", ")
        return f"{self.info.title} ({chosen})" if chosen else self.info.title

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
        return self.target.rpartition(":")[0]

    @property
    def is_foreign(self) -> bool:
        """Return whether it comes from a plugin file or an installed package."""
        return self.module.partition(".")[0] not in FIRST_PARTY

    @property
    def info(self) -> Info:
        """Return what it says about itself."""
        if self._remote:
            return cast(Info, msgspec.convert(self._remote.facts["info"], self.info_type))
        return cast(Info, self.load().info)

    @property
    def _remote(self) -> Any:
        """What stands for it where this process must not import it; None where it may."""
        return reached(self) if self.is_foreign else None

    @property
    def facts(self) -> dict[str, Any]:
        """What another process is told of it, as JSON carries it."""
        return {
            "kind": self.kind,
            "target": self.target,
            "name": self.name,
            "info": dataclasses.asdict(self.info),
            "chosen": plain(self.parameters),
            "parameters": {} if self.missing_packages() else plain(self.resolved_parameters()),
            "sources": self.sources,
            "summary": self.summary,
            "texts": [dataclasses.asdict(text) for text in self.parameter_texts],
        }

    @property
    def summary(self) -> str:
        """What it does, in one line."""
        if self._remote:
            return str(self._remote.facts["summary"])
        return self.info.summary or (inspect.getdoc(self.load()) or "").partition("\n")[0]

    @property
    def parameter_texts(self) -> list[ParameterText]:
        """Parameters in words."""
        if self._remote:
            return msgspec.convert(self._remote.facts["texts"], list[ParameterText])
        return described(self.load())

    def load(self) -> type[Any]:
        """Import and return the class; what its module prints goes to stderr.

        Raises
        ------
        ConfigurationError
            If it cannot be imported, or does not say what it is.
        """
        place, attribute = self.module, self.target.rpartition(":")[2]
        if self.is_foreign:
            require_open_process(place)
            adopt()
        try:
            with one_of_us(), redirect_stdout(sys.stderr):
                module = import_plugin(place) if place.endswith(".py") else importlib.import_module(place)
                found = getattr(module, attribute)
        except ImportError as error:
            raise ConfigurationError(
                f"{self.kind} '{self.base_name}' cannot be imported: {error}", f"install what {place} needs"
            ) from error
        except AttributeError as error:
            raise ConfigurationError(f"{place} has no '{attribute}'", "correct the entry point") from error
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigurationError(
                f"{self.kind} '{self.base_name}' cannot be imported: {one_line(error)}", f"repair {place}"
            ) from error
        if not isinstance(getattr(found, "info", None), self.info_type):
            raise ConfigurationError(f"{self.target} has no 'info: ClassVar[{self.info_type.__name__}]'", self.hint)
        return cast(type[Any], found)

    def create(self) -> Made:
        """Make it with its parameters.

        Raises
        ------
        ConfigurationError
            If the class refuses them, or what it makes keeps no contract.
        """
        if self._remote:
            return cast(Made, self._remote.create())
        found = self.load()
        try:
            with one_of_us():
                created = found(**self.parameters)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigurationError(
                f"{self.name} cannot be made: {one_line(error)}",
                "choose other parameters" if self.parameters else "give every parameter a default that fits",
            ) from error
        if not isinstance(created, self.contracts):
            raise ConfigurationError(f"{self.target} {self.lacking}", self.hint)
        return cast(Made, created)

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included, normalised."""
        return dict(self._resolved)

    def key_parameters(self) -> dict[str, Any]:
        """Parameters as keys name them: of a part of the suite, whose defaults its golden results hold, the others."""
        return self.resolved_parameters() if self.is_foreign else dict(self.parameters)

    @cached_property
    def _resolved(self) -> Mapping[str, Any]:
        if self._remote:
            return dict(self._remote.facts["parameters"])
        return parameter_values(self.create())

    @cached_property
    def sources(self) -> dict[str, str]:
        """See :func:`benchmark.plugins.modules.sources_of`; empty for a part of the suite."""
        if not self.is_foreign:
            return {}
        if self._remote:
            return dict(self._remote.facts["sources"])
        self.load()
        return sources_of(self.module, self.info.files)

    def missing_packages(self) -> tuple[str, ...]:
        """Packages that it declares and that are not installed."""
        return tuple(name for name in self.info.requires if importlib.util.find_spec(name) is None)

    def with_parameters(self, parameters: Mapping[str, Any]) -> Self:
        """Return the same with further parameters, as text or as they are."""
        return dataclasses.replace(self, parameters={**self.parameters, **parameters})


@dataclass(frozen=True)
class MethodSpec(PluginSpec[MethodInfo, Method | Descriptor]):
    """A method, a descriptor or a learner by name."""

    kind = "method"
    info_type = MethodInfo
    contracts = (Method, Descriptor)
    lacking = "has neither 'canonicalise' nor 'describe' and 'distances'"
    hint = "see 'Add a method' in the README"

    @property
    def learns(self) -> bool:
        """Return whether the method is a learner; see :class:`benchmark.api.learning.Learner`."""
        if self._remote:
            return bool(self._remote.facts["learns"])
        found = self.load()
        return all(hasattr(found, name) for name in ("train", "load", "model_name", "split"))

    @property
    def describes(self) -> bool:
        """Return whether the method is a descriptor, which compares shapes without a form and so without a scorer."""
        if self._remote:
            return bool(self._remote.facts["describes"])
        found = self.load()
        return not hasattr(found, "canonicalise") and hasattr(found, "describe")

    @property
    def split(self) -> str:
        """Data that trains a learner, see :class:`benchmark.api.learning.Learner`."""
        return str(self._remote.facts["learner"]["split"] if self._remote else self.load().split)

    @property
    def facts(self) -> dict[str, Any]:
        """See :class:`PluginSpec`."""
        facts = super().facts | {"describes": self.describes, "learns": self.learns}
        if not self.learns or self.missing_packages():
            return facts
        learner: Any = self.create()
        folder = getattr(learner, "model_folder", None)
        return facts | {
            "learner": {
                "model_name": learner.model_name,
                "split": learner.split,
                "shipped_models": str(learner.shipped_models),
                "model_folder": str(folder) if isinstance(folder, Path) else None,
            }
        }


@dataclass(frozen=True)
class ScorerSpec(PluginSpec[ScorerInfo, Scorer]):
    """A scorer by name; without any, that of the tables of the paper."""

    kind = "scorer"
    info_type = ScorerInfo
    contracts = (Scorer,)
    lacking = "lacks 'signature' or 'compare'"
    hint = "see 'A scorer' in docs/reference/plugins.md"

    base_name: str = DEFAULT_SCORER
    target: str = "retrieval.cmbof:CMBOF"

    def create(self) -> Scorer:
        """Make it with its parameters; raises ``ConfigurationError`` also if a package is missing."""
        if missing := self.missing_packages():
            raise ConfigurationError(
                f"scorer '{self.base_name}' needs {', '.join(missing)}", f"pip install {' '.join(missing)}"
            )
        return super().create()


S = TypeVar("S", bound=PluginSpec[Any, Any])


def plugins_of(kind: type[S], path: Path) -> list[S]:
    """Plugins of a kind that a file defines, in the order of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, or one says of itself what cannot be.
    """
    if is_closed():
        return [kind(facts["name"], facts["target"]) for facts in facts_of_file(str(path.resolve()), kind.kind)]
    found = []
    for attribute, info in classes_of(path, kind.info_type):
        for problem, hint in problems_of(info):
            raise ConfigurationError(f"plugin {path}, {attribute}: {problem}", hint)
        found.append(kind(info.name, f"{path.resolve()}:{attribute}"))
    return found


def plugin_methods(path: Path) -> list[MethodSpec]:
    """Methods defined in a plugin file; none where it brings something else.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, defines nothing, or a plugin says of itself what cannot be.
    """
    found = plugins_of(MethodSpec, path)
    if not found and not plugins_of(ScorerSpec, path) and not data_sets_of([path]):
        raise ConfigurationError(
            f"plugin {path} defines no method, no scorer and no data set",
            "give a class an 'info' that is a MethodInfo, a ScorerInfo or a DatasetInfo, or use @canonical_form",
        )
    return found


#: Random draws of a scorer, each of which ranks the whole gallery.
_MOST_DRAWS = 100


def problems_of(info: MethodInfo | ScorerInfo) -> Iterator[tuple[str, str]]:
    """Return what is wrong with what a method, or a scorer, says about itself: each problem with its hint."""
    yield from (_problems_of_method(info) if isinstance(info, MethodInfo) else _problems_of_scorer(info))


def _problems_of_method(info: MethodInfo) -> Iterator[tuple[str, str]]:
    if isinstance(info.name, str) and info.name in RESERVED:
        yield f"name '{info.name}' stands for several methods on the command line", "choose another name"
    yield from _problems_of_texts(info, ("title", "summary", "departs", "cite"))
    if not _are_words(info.inputs) or not info.inputs or not set(info.inputs) <= set(get_args(Input)):
        yield f"inputs are {info.inputs!r}", "name 'mesh', 'view' or both in a tuple"
    choices = get_type_hints(MethodInfo)
    for field, proposal in (("scale", "'equivariant' or 'invariant'"), ("family", "'extended'")):
        if getattr(info, field) not in get_args(choices[field]):
            yield f"{field} is {getattr(info, field)!r}", f"write {proposal}"
    deterministic: Any = info.deterministic
    if not isinstance(deterministic, bool):
        yield f"deterministic is {deterministic!r}", "write True or False"


def _problems_of_scorer(info: ScorerInfo) -> Iterator[tuple[str, str]]:
    yield from _problems_of_texts(info)
    draws: Any = info.draws
    if type(draws) is not int or not 1 <= draws <= _MOST_DRAWS:
        yield f"draws is {draws!r:.80}", f"write a whole number from 1 to {_MOST_DRAWS}"
    invariant: Any = info.invariant
    if not isinstance(invariant, bool):
        yield f"invariant is {invariant!r:.80}", "write True or False"


def _problems_of_texts(
    info: MethodInfo | ScorerInfo, fields: Iterable[str] = ("title", "summary", "cite")
) -> Iterator[tuple[str, str]]:
    """Return what is wrong with what both say."""
    if not is_name(info.name):
        said = f"name {info.name!r:.80} is not lower-case words joined by hyphens"
        yield said, f"write it so, with {LONGEST_NAME} characters at most"
    for field in fields:
        value = getattr(info, field)
        if not isinstance(value, str) or "\n" in value:
            yield f"{field} {value!r:.80} is not a text of one line", "write a text"
    if isinstance(info.title, str) and not info.title.strip():
        yield "title is empty", "say what the tables shall print"
    if not _are_words(info.requires):
        yield f"requires is {info.requires!r}", "write a tuple of the import names of packages"
    if not _are_words(info.files):
        yield f"files is {info.files!r}", "write a tuple of paths"


def _are_words(values: Any) -> bool:
    return isinstance(values, tuple | list) and all(isinstance(value, str) for value in values)

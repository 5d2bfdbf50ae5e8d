"""Plugins in the process that talks to the user, which imports none: their own processes tell it their facts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from benchmark.api.contracts import MethodInfo
from benchmark.api.learning import read_card
from benchmark.execution.processes.calls import Guard
from benchmark.plugins.inspection import LIMIT, facts_of_file, look, told
from benchmark.plugins.remote import Foreign, Remote, RemoteMethod
from benchmark.plugins.serving import spec_of, tell
from benchmark.plugins.specs import PluginSpec

__all__ = ["facts_of_file", "reach"]


def reach(spec: PluginSpec[Any, Any]) -> Remote:
    """Return what stands for a plugin in a process that imports none and has nobody to watch over it."""
    return _Inspected(spec.kind, spec.target, spec.name, spec.base_name)


@dataclass(frozen=True)
class _Inspected(Remote):
    """The same for the process that talks to the user: a plugin that hangs or crashes costs it an error."""

    @property
    def facts(self) -> dict[str, Any]:
        """See :class:`Remote`."""
        key = (self.kind, self.target, self.name)
        if key not in told:
            facts = self._look(tell)
            told[key] = told[self.kind, self.target, facts["name"]] = facts
        return told[key]

    def chosen(self, parameters: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the parameters that differ from their defaults, normalised."""
        chosen = self.facts["chosen"]
        return {name: tuple(value) if isinstance(value, list) else value for name, value in chosen.items()}

    def create(self) -> Foreign:
        """See :class:`Remote`; a learner knows its models."""
        if "learner" in self.facts:
            return _InspectedLearner(self, msgspec.convert(self.facts["info"], MethodInfo))
        return super().create()

    def check_card(self, folder: Path) -> None:
        """Have the card of a model checked."""
        self._look(_check_card, str(folder))

    def _look(self, function: Callable[..., Any], *arguments: str) -> Any:
        hint = "correct the plugin: importing it and making its methods must end at once"
        guard = Guard(f"{self.kind} '{self.name}'", hint, LIMIT, quiet=True)
        return look(function, self.kind, self.name, self.base_name, self.target, *arguments, guard=guard)


@dataclass(frozen=True)
class _InspectedLearner(RemoteMethod):
    """A learner that was looked at; see :class:`benchmark.api.learning.Learner`."""

    remote: _Inspected

    @property
    def model_name(self) -> str:
        return str(self.remote.facts["learner"]["model_name"])

    @property
    def split(self) -> str:
        return str(self.remote.facts["learner"]["split"])

    @property
    def shipped_models(self) -> Path:
        return Path(self.remote.facts["learner"]["shipped_models"])

    @property
    def model_folder(self) -> Path | None:
        folder = self.remote.facts["learner"]["model_folder"]
        return None if folder is None else Path(folder)

    def train(self, *_: object) -> NoReturn:
        raise AssertionError("a plugin is trained in a process of its own")

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        self.remote.check_card(folder)


def _check_card(kind: str, name: str, base_name: str, target: str, folder: str) -> None:
    """Check the card of a model, in a process that may import the learner."""
    check = getattr(spec_of(kind, name, base_name, target).create(), "check_card", None)
    if check is not None:
        check(read_card(Path(folder)), Path(folder))

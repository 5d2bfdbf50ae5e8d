"""Plugins in processes of their own: what each tells of itself, and methods and scorers whose work is done there.

There is one process for each plugin file and kind: they share no knowledge. Facts that a process watched by nobody
needs are told by processes that end at once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, FloatArray, Shape
from benchmark.api.scoring import SignatureArrays
from benchmark.arrays import Arrays
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import BrokenCall, Guard, KilledCall, call_apart
from benchmark.execution.processes.process import Process, Serve, is_child
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.costs import Cost
from benchmark.pipeline.storage.keys import plain
from benchmark.plugins import close_process
from benchmark.plugins.serving import folded

Facts = dict[str, Any]

#: Seconds that importing a file, making its methods and listing the shapes of its data sets may take.
LIMIT = 30.0

#: Deaths by somebody else's hand after which a file is blamed for them.
_MAX_RETRIES = 3

#: Processes at work, by kind and plugin file, and by name where one leaves threads or processes behind.
_processes: dict[tuple[str, ...], Process] = {}

#: What plugins have told, by kind, target and parameters.
_told: dict[str, Facts] = {}

_starting: Callable[[bool], object] = bool


def close_to_plugins(starting: Callable[[bool], object] = bool) -> None:
    """Let no plugin into this process from now on: their methods and scorers work in processes of their own.

    Parameters
    ----------
    starting
        Called with True before a process starts and imports its plugin, and with False after that.
    """
    global _starting
    _starting = starting
    close_process()


def look(function: Callable[..., Any], *arguments: Any, what: str, hint: str) -> Any:
    """Call a function that imports foreign code apart, again if somebody else may have ended its process.

    Raises
    ------
    ConfigurationError
        If the code crashes, ends its process or takes too long.
    """
    for retries in reversed(range(_MAX_RETRIES)):
        try:
            return call_apart(function, *arguments, guard=Guard(what, hint, LIMIT, quiet=True))
        except BrokenCall as error:
            if not (retries and isinstance(error, KilledCall)):
                raise ConfigurationError(error.problem, error.hint) from error


def remember(*plugins: Facts) -> None:
    """Note what plugins have told of themselves."""
    _told.update({_key(facts["kind"], facts["target"], facts["chosen"]): facts for facts in plugins})


def _key(*names: Any) -> str:
    return json.dumps(names, sort_keys=True)


@dataclass(frozen=True)
class Remote:
    """A plugin in its process, by what names it there.

    Parameters
    ----------
    serve
        What its process answers requests with.
    kind, base_name, target, parameters
        See :class:`benchmark.plugins.specs.PluginSpec`.
    """

    serve: Serve
    kind: str
    base_name: str
    target: str
    parameters: Mapping[str, Any]

    @property
    def facts(self) -> Facts:
        """What it tells of itself, see :attr:`benchmark.plugins.specs.PluginSpec.facts`."""
        key = _key(self.kind, self.target, plain(self.parameters))
        if key not in _told:
            _told[key] = self.request("facts")[0] if is_child() else self.look("facts")
            remember(_told[key])
        return _told[key]

    def look(self, work: str, **facts: Any) -> Facts:
        """Have some work done in a process that ends at once."""
        hint = "correct the plugin: importing it and making its methods must end at once"
        what = f"{self.kind} '{self.base_name}'"
        answer: Facts = look(_answer, self.serve, self._message(work, facts), what=what, hint=hint)
        return answer

    @property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Place of its process, that which it shares with others of its plugin, and that which is its own."""
        shared = (self.kind, self.target.rpartition(":")[0])
        own = (*shared, self.base_name)
        return (own if own in _processes else shared), shared, own

    @property
    def files(self) -> dict[str, str]:
        """Files that its process has read, with their digests."""
        process = _processes.get(self._places[0])
        return process.files if process else {}

    def request(
        self, work: str, facts: Mapping[str, Any] | None = None, arrays: Arrays | None = None
    ) -> tuple[Facts, Arrays]:
        """Have some work done; a process that starts is asked for facts, which takes no time of a job."""
        place, shared, own = self._places
        if place not in _processes:
            _starting(True)
            try:
                _processes[place] = Process(self.serve, is_plugin=True)
                _processes[place].request_or_end_alike(self._message("facts", {}))
            finally:
                _starting(False)
        process = _processes[place]
        try:
            return process.request_or_end_alike(self._message(work, facts or {}), arrays)
        finally:
            if process.is_occupied and place == shared and work != "facts":  # facts import the plugin, for all of it
                _processes[own] = _processes.pop(shared)

    def _message(self, work: str, facts: Mapping[str, Any]) -> Facts:
        names = {"kind": self.kind, "base_name": self.base_name, "target": self.target}
        return {"work": work, **names, "parameters": plain(self.parameters), **facts}


def _answer(serve: Serve, message: Facts) -> Facts:
    """Facts of an answer, in a process that may import the plugin."""
    return dict(serve(message, {}, None)[0])  # type: ignore[arg-type]  # nobody is told of progress


@dataclass(frozen=True)
class Foreign:
    """A method or scorer whose work is done in the process of its plugin.

    Parameters
    ----------
    remote
        Has the work done.
    info
        What it says about itself.
    book
        Told the cost of each work.
    model
        Folder of the trained model; "" where it does not learn.
    """

    remote: Remote
    info: Any
    book: Callable[[Cost], None] = lambda cost: None
    model: str = ""

    @property
    def files(self) -> dict[str, str]:
        """Files that its process has read so far, with their digests."""
        return self.remote.files

    def _work(self, work: str, facts: Mapping[str, Any], arrays: Arrays) -> Arrays:
        answer, results = self.remote.request(work, {**facts, "model": self.model}, arrays)
        if "cost" in answer:
            self.book(Cost.from_json(answer["cost"]))
        return results

    def _on_shape(self, work: str, shape: Shape) -> Arrays:
        facts = {"seed": shape.seed, "source_area": shape.source_area}
        depth = {} if shape.depth is None else {"depth": shape.depth}
        return self._work(work, facts, {"vertices": shape.mesh.vertices, "faces": shape.mesh.faces, **depth})


class RemoteMethod(Foreign):
    """A method in the process of its plugin."""

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """See :class:`benchmark.api.contracts.Method`."""
        form = self._on_shape("canonicalise", shape)
        notes = {name.removeprefix("note:"): value.item() for name, value in form.items() if name.startswith("note:")}
        return CanonicalForm(form["vertices"], form["faces"], notes)


@dataclass(frozen=True)
class RemoteLearner(RemoteMethod):
    """A learner in the process of its plugin; see :class:`benchmark.api.learning.Learner`."""

    model_name: str = ""
    split: str = ""
    shipped_models: Path = Path()
    model_folder: Path | None = None

    def train(self, *_: object) -> NoReturn:
        """Raise ``AssertionError``: it is trained where it is imported."""
        raise AssertionError("a plugin is trained in a process of its own")

    def load(self, folder: Path) -> Self:
        """Return the same with a model."""
        return replace(self, model=str(folder))

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` if the card is none of its own."""
        self.remote.look("check_card", folder=str(folder))


class RemoteDescriptor(Foreign):
    """A descriptor in the process of its plugin."""

    def describe(self, shape: Shape) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        return np.asarray(self._on_shape("describe", shape)["descriptor"])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """See :class:`benchmark.api.contracts.Descriptor`."""
        arrays = folded([{"descriptor": descriptor} for descriptor in descriptors])
        return np.asarray(self._work("distances", {}, arrays)["distances"])


class RemoteScorer(Foreign):
    """A scorer in the process of its plugin."""

    def signature(self, form: Mesh) -> SignatureArrays:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return self._work("signature", {}, {"vertices": form.vertices, "faces": form.faces})

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return np.asarray(self._work("compare", {"draw": draw}, folded(signatures))["distances"])

"""Plugins in separate processes, which report their facts and do the work of their methods and scorers.

Each plugin file has its own process for each kind of plugin, so that they share no information. A process that runs no
jobs gets facts from processes that end immediately.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, FloatArray, Shape
from benchmark.api.scoring import SignatureArrays
from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.execution.processes.calls import BrokenCall, KilledCall, call_apart
from benchmark.execution.processes.process import ForeignError, Process, ProcessEnded, Serve, is_child
from benchmark.geometry.mesh import Mesh
from benchmark.machine import memory_per_process
from benchmark.pipeline.storage.costs import Cost
from benchmark.pipeline.storage.keys import plain
from benchmark.plugins import close_process
from benchmark.plugins.serving import folded

Facts = dict[str, Any]

#: Time limit in seconds for importing a file, creating its methods and listing the shapes of its data sets.
LIMIT = 30.0

#: Seconds that sending a request and its answer may take.
_TRANSFER = 0.05

#: Number of kills from outside after which a file is blamed for them.
_MAX_RETRIES = 3

#: Running processes by kind and plugin file, and by name if a plugin leaves threads or processes behind.
_processes: dict[tuple[str, ...], Process] = {}

#: Facts of plugins by kind, target and parameters.
_known_facts: dict[str, Facts] = {}

_starting: Callable[[bool], object] = bool


def close_to_plugins(starting: Callable[[bool], object] = bool) -> None:
    """Forbid plugins in this process from now on: their methods and scorers run in separate processes.

    Parameters
    ----------
    starting
        Called with True before a process starts and imports its plugin, and with False afterwards.
    """
    global _starting
    _starting = starting
    close_process()


def look(function: Callable[..., Any], *arguments: Any, what: str, hint: str) -> Any:
    """Call a function that imports foreign code in a separate process; retry if it was killed from outside.

    Raises
    ------
    ConfigurationError
        If the code crashes, ends its process or takes too long.
    """
    for retries in reversed(range(_MAX_RETRIES)):
        try:
            return call_apart(function, *arguments, what=what, hint=hint, limit=LIMIT, quiet=True)
        except BrokenCall as error:
            if not (retries and isinstance(error, KilledCall)):
                raise ConfigurationError(error.problem, error.hint) from error


def remember(*plugins: Facts) -> None:
    """Store the facts of plugins."""
    _known_facts.update({_key(facts["kind"], facts["target"], facts["chosen"]): facts for facts in plugins})


def _key(*names: Any) -> str:
    return json.dumps(names, sort_keys=True)


@dataclass(frozen=True)
class Remote:
    """A plugin in its process, with the values that identify it there.

    Parameters
    ----------
    serve
        Handler of requests in its process.
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
        """Facts of the plugin; see :attr:`benchmark.plugins.specs.PluginSpec.facts`."""
        key = _key(self.kind, self.target, plain(self.parameters))
        if key not in _known_facts:
            _known_facts[key] = self.request("facts")[0] if is_child() else self.look("facts")
            remember(_known_facts[key])
        return _known_facts[key]

    def look(self, work: str, **facts: Any) -> Facts:
        """Send a request to a process that ends immediately afterwards."""
        hint = "correct the plugin: importing it and creating its methods must not take long"
        what = f"{self.kind} '{self.base_name}'"
        answer: Facts = look(_answer, self.serve, self._message(work, facts), what=what, hint=hint)
        return answer

    @property
    def _places(self) -> tuple[tuple[str, ...], ...]:
        """Keys of its current process, of the one shared with its plugin file, and of its own."""
        shared = (self.kind, self.target.rpartition(":")[0])
        own = (*shared, self.base_name)
        return (own if own in _processes else shared), shared, own

    @property
    def files(self) -> dict[str, str]:
        """Digests of the files that its process has read, by path."""
        process = _processes.get(self._places[0])
        return process.files if process else {}

    def request(
        self, work: str, facts: Mapping[str, Any] | None = None, arrays: Arrays | None = None
    ) -> tuple[Facts, Arrays]:
        """Send a request; a new process is first asked for facts, in time that does not count towards a job."""
        place, shared, own = self._places
        limit = None if is_child() else LIMIT  # a job has limits of its own
        try:
            if place not in _processes:
                self._start(place, limit)
            begun = time.perf_counter()
            answer, results = _processes[place].request(self._message(work, facts or {}), arrays, limit=limit)
            return {**answer, "elapsed": time.perf_counter() - begun}, results
        except TimeoutError as error:
            _processes.pop(place).end()
            problem = f"{self.kind} '{self.base_name}' does not answer '{work}' within {LIMIT:g} s"
            raise ConfigurationError(problem, "correct the plugin") from error
        except (ProcessEnded, ForeignError) as error:
            if is_child():
                raise
            verb = "ended its process:" if isinstance(error, ProcessEnded) else "raises"
            raise BenchmarkError(f"a plugin {verb} {error}", "correct it; 'check' shows more") from error
        finally:
            process = _processes.get(place)
            if process and process.is_occupied and place == shared and work != "facts":  # facts import the plugin
                _processes[own] = _processes.pop(shared)

    def _start(self, place: tuple[str, ...], limit: float | None) -> None:
        """Start the process of the plugin, and let it import the plugin."""
        _starting(True)
        try:
            memory = None if is_child() else memory_per_process()
            _processes[place] = Process(self.serve, is_plugin=True, memory=memory)
            _processes[place].request(self._message("facts", {}), limit=limit)
        finally:
            _starting(False)

    def _message(self, work: str, facts: Mapping[str, Any]) -> Facts:
        names = {"kind": self.kind, "base_name": self.base_name, "target": self.target}
        return {"work": work, **names, "parameters": plain(self.parameters), **facts}


def _answer(serve: Serve, message: Facts) -> Facts:
    """Return the facts of an answer, in a process that may import the plugin."""
    return dict(serve(message, {}, None)[0])  # type: ignore[arg-type]  # progress is not reported


@dataclass(frozen=True)
class Foreign:
    """A method or scorer that runs in the process of its plugin.

    Parameters
    ----------
    remote
        Plugin that receives the requests.
    info
        Description of the method or scorer.
    book
        Called with the cost of each request.
    model
        Folder of the trained model; "" if it does not learn.
    """

    remote: Remote
    info: Any
    book: Callable[[Cost], None] = lambda cost: None
    model: str = ""

    @property
    def files(self) -> dict[str, str]:
        """Digests of the files that its process has read so far, by path."""
        return self.remote.files

    def _work(self, work: str, facts: Mapping[str, Any], arrays: Arrays) -> Arrays:
        answer, results = self.remote.request(work, {**facts, "model": self.model}, arrays)
        if "cost" in answer:  # reported by the plugin's process, so it must agree with the time that passed here
            cost = Cost.from_json(answer["cost"])
            least = answer["elapsed"] - sum(part.seconds for part in cost.shared.values()) - _TRANSFER
            self.book(structs.replace(cost, seconds=max(cost.seconds, least)))
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
        """Raise ``AssertionError``: training runs in the process that imports the plugin."""
        raise AssertionError("a plugin is trained in a separate process")

    def load(self, folder: Path) -> Self:
        """Return the same learner with a model."""
        return replace(self, model=str(folder))

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` if the card does not belong to this learner."""
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

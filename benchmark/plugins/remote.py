"""Plugins in separate processes, which report their facts and do the work of their methods and scorers.

The first part sends requests to these processes; the second part answers there.

Each plugin file has its own process for each kind of plugin, so that they share no information. A process that runs no
jobs gets facts from processes that end immediately.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, FloatArray, Shape
from benchmark.api.datasets import Entry, ListsShapes
from benchmark.api.scoring import SignatureArrays
from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, UnreadableMesh, one_line
from benchmark.execution.processes.calls import BrokenCall, KilledCall, call_apart
from benchmark.execution.processes.process import ForeignError, Process, ProcessEnded, Serve, is_child
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh
from benchmark.machine import memory_per_process
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.pipeline.storage.keys import plain
from benchmark.plugins import close_process
from benchmark.plugins.output_checks import descriptor_of, distances_of, form_distances, form_of, signature_of

Facts = Mapping[str, Any]
Answer = tuple[dict[str, Any], Arrays]

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

    def stand_in(self, spec: Any) -> Foreign:
        """Return an object that forwards requests, for the specification of a method or scorer."""
        if self.kind == "scorer":
            return RemoteScorer(self, spec.info)
        if spec.describes:
            return RemoteDescriptor(self, spec.info)
        return RemoteLearner(self, spec.info, **vars(spec.learner)) if spec.learner else RemoteMethod(self, spec.info)

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

    def request(self, work: str, facts: Facts | None = None, arrays: Arrays | None = None) -> Answer:
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

    def _message(self, work: str, facts: Facts) -> Facts:
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

    def _work(self, work: str, facts: Facts, arrays: Arrays) -> Arrays:
        answer, results = self.remote.request(work, {**facts, "model": self.model}, arrays)
        if "cost" in answer:  # reported by the plugin's process, so it must agree with the time that passed here
            cost = Cost.from_json(answer["cost"])
            least = answer["elapsed"] - sum(part.seconds for part in cost.shared.values()) - _TRANSFER
            self.book(structs.replace(cost, seconds=max(cost.seconds, least)))
        return results

    def _on_shape(self, work: str, shape: Shape) -> Arrays:
        facts = {"seed": shape.seed, "source_area": shape.source_area}
        depth = {} if shape.depth is None else {"depth": shape.depth}
        return self._work(work, facts, {**_arrays_of(shape.mesh), **depth})


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
        return self._work("signature", {}, _arrays_of(form))

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """See :class:`benchmark.api.scoring.Scorer`."""
        return np.asarray(self._work("compare", {"draw": draw}, folded(signatures))["distances"])


# In the process of a plugin ------------------------------------------------------------------------------------------

# Requests reveal neither names, nor classes, nor the order of a gallery.

_meter = Meter()

#: Results of a data set for a shape: type, hint for any other type, and conversion to arrays.
_OF_SHAPES: Mapping[str, tuple[type[Any], str, Callable[[Any], Answer]]] = {
    "load": (Mesh, "return Mesh(vertices, faces)", lambda mesh: ({}, _arrays_of(mesh))),
    "camera": (Camera, "return a Camera", lambda camera: (asdict(camera), {})),
    "recipe": (object, "", lambda recipe: ({"recipe": str(recipe)}, {})),
}


@dataclass(frozen=True)
class OpenedDataset:
    """A data set of a plugin file with its shapes."""

    dataset: ListsShapes
    entries: tuple[Entry, ...]

    def ask(self, work: str, identifier: str) -> Answer:
        """Call a method of the data set with a shape; any error affects only that shape."""
        kind, hint, packed = _OF_SHAPES[work]
        who = f"data set '{self.dataset.info.name}', shape '{identifier}': '{work}'"
        entry = next(entry for entry in self.entries if entry.identifier == identifier)
        try:
            result = getattr(self.dataset, work)(entry)
        except (BenchmarkError, MemoryError):
            raise
        except Exception as error:
            raise UnreadableMesh(f"{who} raises {one_line(error)}", "correct the file") from error
        if not isinstance(result, kind):
            error_type = UnreadableMesh if kind is Mesh else DatasetError
            raise error_type(f"{who} returned {type(result).__name__}", hint)
        return packed(result)


def answer(plugin: Any, facts: Facts, arrays: Arrays) -> Answer:
    """Answer a request."""
    if isinstance(plugin, OpenedDataset):
        return plugin.ask(facts["work"], facts["identifier"])
    with _meter.measured(f"{facts['work']} {facts['base_name']}") as cost:
        results = WORK[facts["work"]](plugin, facts, arrays)
    return {"cost": cost().to_json()}, results


def _form(method: Any, facts: Facts, arrays: Arrays) -> Arrays:
    mesh, notes = form_of(method, _shape(facts, arrays))
    return {**_arrays_of(mesh), **{f"note:{name}": note for name, note in notes.items()}}


def _descriptor_distances(method: Any, _: Facts, arrays: Arrays) -> Arrays:
    return {"distances": distances_of(method, [item["descriptor"] for item in unfolded(arrays)])}


#: Requests to a method or a scorer, by name.
WORK: Mapping[str, Callable[[Any, Facts, Arrays], Arrays]] = {
    "canonicalise": _form,
    "describe": lambda method, facts, arrays: {"descriptor": descriptor_of(method, _shape(facts, arrays))},
    "distances": _descriptor_distances,
    "signature": lambda scorer, _, arrays: signature_of(scorer, Mesh(arrays["vertices"], arrays["faces"])),
    "compare": lambda scorer, facts, arrays: {
        "distances": form_distances(scorer, list(unfolded(arrays)), facts["draw"])
    },
}


def _arrays_of(mesh: Mesh) -> Arrays:
    return {"vertices": mesh.vertices, "faces": mesh.faces}


def folded(signatures: Sequence[Arrays]) -> dict[str, Any]:
    """Combine the arrays of several signatures in one message."""
    return {f"{k}:{name}": array for k, arrays in enumerate(signatures) for name, array in arrays.items()}


def unfolded(arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Yield the signatures combined by :func:`folded`, in order."""
    signatures: dict[int, dict[str, Any]] = {}
    for name, array in arrays.items():
        number, _, rest = name.partition(":")
        signatures.setdefault(int(number), {})[rest] = array
    yield from (signatures[number] for number in sorted(signatures))


_latest: dict[tuple[Any, ...], Shape] = {}


def _shape(facts: Facts, arrays: Arrays) -> Shape:
    """Return the shape of a request, named by a number; the methods of one file share its geodesics."""
    seed, area = int(facts["seed"]), facts["source_area"]
    key = (seed, area, *(arrays[name].tobytes() for name in sorted(arrays)))
    if key not in _latest:
        mesh, cache = Mesh(arrays["vertices"], arrays["faces"]), SharedStages(_meter)
        shape = Shape(identifier="", mesh=mesh, depth=arrays.get("depth"), source_area=area, seed=seed, cache=cache)
        shape.identifier = str(shape.random("identifier").integers(2**53))
        _latest.clear()
        _latest[key] = shape
    return _latest[key]


class SharedStages:
    """Arrays that the methods of one shape share in memory; each method is charged the full cost."""

    def __init__(self, meter: Meter) -> None:
        self._meter = meter
        self._results: dict[str, tuple[Arrays, Cost]] = {}

    def get_or_compute(self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Arrays]) -> Arrays:
        """See :class:`benchmark.api.contracts.ArtefactCache`."""
        name = f"{stage} {sorted(parameters.items())}"
        if name in self._results:
            arrays, cost = self._results[name]
            self._meter.share(stage, cost)
            return arrays
        with self._meter.measured(name) as measured:
            arrays = compute()
        cost = measured()
        self._meter.share(stage, cost)  # the peak of the calling stage includes its memory
        size = sum(array.nbytes for array in arrays.values()) / 2**20
        self._results[name] = (arrays, Cost(cost.seconds, cost.peak_mib, cost.first_use, size))
        return arrays

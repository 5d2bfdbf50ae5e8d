"""Answer requests in the process of a plugin, without revealing names, classes or the order of a gallery."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Shape
from benchmark.api.datasets import Entry, ListsShapes
from benchmark.api.learning import read_card
from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh, one_line
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.plugins.output_checks import descriptor_of, distances_of, form_distances, form_of, signature_of

Facts = Mapping[str, Any]
Answer = tuple[dict[str, Any], Arrays]

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


def _check_card(method: Any, facts: Facts, _: Arrays) -> Arrays:
    if hasattr(method, "check_card"):
        method.check_card(read_card(Path(facts["folder"])), Path(facts["folder"]))
    return {}


#: Requests to a method or a scorer, by name.
WORK: Mapping[str, Callable[[Any, Facts, Arrays], Arrays]] = {
    "canonicalise": _form,
    "describe": lambda method, facts, arrays: {"descriptor": descriptor_of(method, _shape(facts, arrays))},
    "distances": _descriptor_distances,
    "check_card": _check_card,
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

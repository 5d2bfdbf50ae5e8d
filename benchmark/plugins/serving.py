"""A method or scorer of a plugin at work in its process, which is told no name, no class and no order of a gallery."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Shape
from benchmark.arrays import Arrays
from benchmark.execution.processes.process import Requester
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.plugins.output_checks import descriptor_of, distances_of, form_distances, form_of, signature_of
from benchmark.plugins.registry import variant
from benchmark.plugins.specs import MethodSpec, PluginSpec, ScorerSpec

Facts = Mapping[str, Any]
Answer = tuple[Facts, Arrays]

_meter = Meter()


def serve(facts: Facts, arrays: Arrays, requester: Requester) -> Answer:
    """Do the work that a request names, with the method or scorer that it names."""
    return _WORK[facts["work"]](facts, arrays)


def tell(kind: str, name: str, base_name: str, target: str) -> dict[str, Any]:
    """Return what a plugin tells of itself."""
    return spec_of(kind, name, base_name, target).facts


def _tell(facts: Facts, arrays: Arrays) -> Answer:
    return tell(facts["kind"], facts["name"], facts["base_name"], facts["target"]), {}


def _canonicalise(facts: Facts, arrays: Arrays) -> Answer:
    method, shape = _plugin(facts), _shape(facts, arrays)

    def form() -> Arrays:
        mesh, notes = form_of(method, shape)
        return {
            "vertices": mesh.vertices,
            "faces": mesh.faces,
            **{f"note:{name}": note for name, note in notes.items()},
        }

    return _measured(facts, form)


def _describe(facts: Facts, arrays: Arrays) -> Answer:
    method, shape = _plugin(facts), _shape(facts, arrays)
    return _measured(facts, lambda: {"descriptor": descriptor_of(method, shape)})


def _distances(facts: Facts, arrays: Arrays) -> Answer:
    return {}, {"distances": distances_of(_plugin(facts), [each["descriptor"] for each in unfolded(arrays)])}


def _signature(facts: Facts, arrays: Arrays) -> Answer:
    return _measured(facts, lambda: signature_of(_plugin(facts), Mesh(arrays["vertices"], arrays["faces"])))


def _compare(facts: Facts, arrays: Arrays) -> Answer:
    return {}, {"distances": form_distances(_plugin(facts), list(unfolded(arrays)), facts["draw"])}


_WORK: Mapping[str, Callable[[Facts, Arrays], Answer]] = {
    "tell": _tell,
    "canonicalise": _canonicalise,
    "describe": _describe,
    "distances": _distances,
    "signature": _signature,
    "compare": _compare,
}


def folded(signatures: Sequence[Arrays]) -> dict[str, Any]:
    """Return the arrays of several signatures as those of one message."""
    return {f"{k}:{name}": array for k, each in enumerate(signatures) for name, array in each.items()}


def unfolded(arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Yield the signatures that :func:`folded` put together, in their order."""
    found: dict[int, dict[str, Any]] = {}
    for name, array in arrays.items():
        number, _, rest = name.partition(":")
        found.setdefault(int(number), {})[rest] = array
    yield from (found[number] for number in sorted(found))


def _measured(facts: Facts, work: Callable[[], Arrays]) -> Answer:
    """Return what some work brought, and what it cost."""
    with _meter.measured(f"{facts['work']} {facts['base_name']}") as cost:
        found = work()
    return {"cost": cost().to_json()}, found


_latest: dict[tuple[Any, ...], Shape] = {}


def _shape(facts: Facts, arrays: Arrays) -> Shape:
    """The shape of a request, which bears a number for a name; the methods of one file share its geodesics."""
    seed, area = int(facts["seed"]), facts["source_area"]
    key = (seed, area, *(arrays[name].tobytes() for name in sorted(arrays)))
    if key not in _latest:
        mesh, cache = Mesh(arrays["vertices"], arrays["faces"]), SharedStages(_meter)
        shape = Shape(identifier="", mesh=mesh, depth=arrays.get("depth"), source_area=area, seed=seed, cache=cache)
        shape.identifier = str(shape.random("identifier").integers(2**53))
        _latest.clear()
        _latest[key] = shape
    return _latest[key]


def _plugin(facts: Facts) -> Any:
    return _made(facts["kind"], facts["name"], facts["base_name"], facts["target"], facts.get("model", ""))


@cache
def _made(kind: str, name: str, base_name: str, target: str, model: str) -> Any:
    made: Any = spec_of(kind, name, base_name, target).create()
    return made.load(Path(model)) if model else made


@cache
def spec_of(kind: str, name: str, base_name: str, target: str) -> PluginSpec[Any, Any]:
    """Return a method or a scorer by its name."""
    spec = MethodSpec if kind == MethodSpec.kind else ScorerSpec
    return variant(name, {base_name: spec(base_name, target)})


class SharedStages:
    """Arrays that the methods of one shape share in memory; each is charged what it would have paid alone."""

    def __init__(self, meter: Meter) -> None:
        self._meter = meter
        self._found: dict[str, tuple[Arrays, Cost]] = {}

    def get_or_compute(self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Arrays]) -> Arrays:
        """See :class:`benchmark.api.contracts.ArtefactCache`."""
        name = f"{stage} {sorted(parameters.items())}"
        if name in self._found:
            arrays, cost = self._found[name]
            self._meter.share(stage, cost)
            return arrays
        with self._meter.measured(name) as measured:
            arrays = compute()
        cost = measured()
        self._meter.share(stage, cost)  # its memory is in the mark of the stage that called
        size = sum(array.nbytes for array in arrays.values()) / 2**20
        self._found[name] = (arrays, Cost(cost.seconds, cost.peak_mib, cost.first_use, size))
        return arrays

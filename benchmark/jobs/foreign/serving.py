"""A method or scorer of a plugin at work in its process, which is told no name, no class and no order of a gallery."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Shape
from benchmark.geometry.mesh import Mesh
from benchmark.jobs.preparation import SharedStages
from benchmark.jobs.stages import form
from benchmark.methods.output_checks import distances_of, form_distances, signature_of
from benchmark.methods.registry import variant
from benchmark.methods.specs import MethodSpec, PluginSpec, ScorerSpec
from benchmark.storage.costs import Meter
from benchmark.system.arrays import Arrays
from benchmark.system.processes import Requester

Facts = Mapping[str, Any]
Answer = tuple[Facts, Arrays]

_meter = Meter()


def serve(facts: Facts, arrays: Arrays, requester: Requester) -> Answer:
    """Do the work that a request names, with the method or scorer that it names."""
    return _WORK[facts["work"]](facts, arrays)


def _tell(facts: Facts, arrays: Arrays) -> Answer:
    return _spec(facts["kind"], facts["name"], facts["base_name"], facts["target"]).facts, {}


def _canonicalise(facts: Facts, arrays: Arrays) -> Answer:
    method = _plugin(facts)
    return _measured(facts, lambda: form.canonicalise(method, _shape(facts, arrays)))


def _describe(facts: Facts, arrays: Arrays) -> Answer:
    method = _plugin(facts)
    return _measured(facts, lambda: form.describe(method, _shape(facts, arrays)))


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
    made: Any = _spec(kind, name, base_name, target).create()
    return made.load(Path(model)) if model else made


@cache
def _spec(kind: str, name: str, base_name: str, target: str) -> PluginSpec[Any, Any]:
    spec = MethodSpec if kind == MethodSpec.kind else ScorerSpec
    return variant(name, {base_name: spec(base_name, target)})

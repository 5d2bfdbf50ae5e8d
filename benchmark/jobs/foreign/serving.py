"""A method or scorer of a plugin at work in its process, which is told no name, no class and no order of a gallery."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.geometry.mesh import Mesh
from benchmark.jobs.preparation import SharedStages
from benchmark.jobs.stages import distances, features, form
from benchmark.methods.registry import MethodSpec, variant
from benchmark.methods.scorers import ScorerSpec, scorer_of
from benchmark.storage.costs import Meter
from benchmark.storage.keys import plain
from benchmark.system.arrays import Arrays
from benchmark.system.services import Ask

Facts = Mapping[str, Any]
Answer = tuple[Facts, Arrays]

_meter = Meter()


def serve(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    """Do the work that a request names, with the method or scorer that it names."""
    return _WORK[facts["work"]](facts, arrays, ask)


def _tell_of_method(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    spec = _method_spec(facts["name"], facts["base_name"], facts["target"])
    _method(facts)
    return {**_told(spec), "inherited": spec.inherited, "describes": spec.describes, "learns": spec.learns}, {}


def _tell_of_scorer(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    return _told(_scorer_spec(facts["name"], facts["base_name"], facts["target"])), {}


def _told(spec: MethodSpec | ScorerSpec) -> Facts:
    parameters = plain(spec.resolved_parameters())
    return {"info": dataclasses.asdict(spec.info), "title": spec.title, "parameters": parameters}


def _canonicalise(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    method: Any = _method(facts)
    return _measured(facts, lambda: form.canonicalise(method, _shape(facts, arrays, ask)))


def _describe(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    method: Any = _method(facts)
    return _measured(facts, lambda: form.describe(method, _shape(facts, arrays, ask)))


def _distances(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    method: Any = _method(facts)
    return {}, {"distances": distances.descriptor_distances(method, [each["descriptor"] for each in unfolded(arrays)])}


def _signature(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    return _measured(facts, lambda: features.extract(_scorer(facts), Mesh(arrays["vertices"], arrays["faces"])))


def _compare(facts: Facts, arrays: Arrays, ask: Ask) -> Answer:
    return {}, {"distances": distances.form_distances(_scorer(facts), list(unfolded(arrays)), facts["draw"])}


_WORK: Mapping[str, Callable[[Facts, Arrays, Ask], Answer]] = {
    "tell of method": _tell_of_method,
    "tell of scorer": _tell_of_scorer,
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


class _NumberedShape(Shape):
    """A shape that bears a number; only whoever knows its name can say what it draws."""

    ask: Ask

    def random(self, purpose: str = "") -> np.random.Generator:
        """See :meth:`benchmark.api.contracts.Shape.random`."""
        return np.random.default_rng(self.ask({"purpose": purpose})["entropy"])


_latest: dict[tuple[str, int], _NumberedShape] = {}


def _shape(facts: Facts, arrays: Arrays, ask: Ask) -> Shape:
    """The shape of a request; the methods of one file share its geodesics."""
    key = (str(facts["number"]), int(facts["seed"]))
    if key not in _latest:
        mesh, cache = Mesh(arrays["vertices"], arrays["faces"]), SharedStages(_meter)
        depth, area = arrays.get("depth"), facts["source_area"]
        _latest.clear()
        _latest[key] = _NumberedShape(
            identifier=key[0], mesh=mesh, depth=depth, source_area=area, seed=key[1], cache=cache
        )
        _latest[key].ask = ask
    return _latest[key]


def _method(facts: Facts) -> Method | Descriptor:
    return _made(facts["name"], facts["base_name"], facts["target"], facts.get("model", ""))


@cache
def _made(name: str, base_name: str, target: str, model: str) -> Method | Descriptor:
    made: Any = _method_spec(name, base_name, target).create()
    found: Method | Descriptor = made.load(Path(model)) if model else made
    return found


@cache
def _method_spec(name: str, base_name: str, target: str) -> MethodSpec:
    return variant(name, {base_name: MethodSpec(base_name, target)})


def _scorer(facts: Facts) -> Scorer:
    return _made_scorer(facts["name"], facts["base_name"], facts["target"])


@cache
def _made_scorer(name: str, base_name: str, target: str) -> Scorer:
    return _scorer_spec(name, base_name, target).create()


@cache
def _scorer_spec(name: str, base_name: str, target: str) -> ScorerSpec:
    return scorer_of(name, {base_name: ScorerSpec(base_name, target)})

"""Components of the suite by name, with their calls on the inputs, tolerances and code."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.changes import CHANGES, STRENGTHS
from benchmark.geometry.camera import DepthSensor
from benchmark.registry import BUILT_IN as METHODS
from benchmark.registry import SCORERS, select_one
from tests.golden import inputs, stages

#: Differences between processors are below 1e-9 of the size of a form.
FORMS = 1e-8
#: Distances, and meshes of generators: sums of doubles without cancellation.
DOUBLES = 1e-9
#: Depth images in single precision, and the surfaces computed from them.
SINGLES = 1e-6

#: Variants of methods and scorers in tables, by base name; their results are in the file of the
#: base.
VARIANTS: Mapping[str, tuple[str, ...]] = {
    "least-squares-mds": ("start=classic",),
    "deformation-field": ("reach=0", "rounds=0"),
    "cm-bof": ("allow_mirror=true", "pose=pca"),
}

#: Small shapes, including shapes that methods refuse, and larger ones.
SMALL = ("small", "small-open", "pieces", "tetrahedron")
LARGER = ("bridged", "closed", "open")
SIGNED = ("closed", "small", "open", "bridged")
RAW = ("dog", "horse", "scan", "flat", "point", "triangle")

#: Arguments of views and frames, by name of the part.
VIEWS = {name: (name, None) for name in RAW} | {
    "dog-far": ("dog", 190.0),
    "dog-too-far": ("dog", 1e5),
}
VIEWS["dog-noisy"] = ("dog", 190.0, DepthSensor(0.002, 0.002, 5))
FRAMES = {"given": (True, None), "found": (False, None), "no-floor": (True, None, False)}
FRAMES |= {"sidecar": (True, (0.1, -1.0, 0.2), False), "upside": (True, (0.0, 0.0, 1.0), False)}

#: Indices of the shapes to generate of each set: every subject and pose of people, every kind of
#: animal.
GENERATED: Mapping[str, tuple[int, ...]] = {
    "humans-scanlike": (1, 157, 398),
    "people": tuple(n % 15 * 20 + n for n in range(20)),
    "animals": (1, 12, 18, 26, 34, 38, 50, 70, 79),
    "animals-few": (1, 16),
}


class Part(NamedTuple):
    """One call: its name, function and arguments."""

    name: str
    make: Callable[..., Mapping[str, Any]]
    arguments: tuple[Any, ...] = ()


class Component(NamedTuple):
    """Parts to compute, and their tolerance."""

    parts: Callable[[], Iterator[Part]]
    tolerance: float = DOUBLES


@cache
def components() -> Mapping[str, Component]:
    """Return all components by name."""
    return dict(_components())


def _components() -> Iterator[tuple[str, Component]]:
    for name in METHODS:
        yield f"method/{name}", Component(partial(_of_method, name), FORMS)
    for name in SCORERS:
        yield f"scorer/{name}", Component(partial(_of_scorer, name))
    raw = {name: (name,) for name in RAW}
    yield "preparation/mesh", Component(partial(_called, stages.completed, raw))
    yield "preparation/view", Component(partial(_called, stages.seen, VIEWS), SINGLES)
    yield "preparation/frame", Component(partial(_called, stages.observed, FRAMES), SINGLES)
    for name in (
        name for name, source in CATALOGUE.items() if not source.folder and "[" not in name
    ):
        yield f"data/{name}", Component(partial(_generated, name), FORMS)
    for name in sorted(CHANGES.keys() - {"perspective"}):
        yield f"change/{name}", Component(partial(_changed, name), FORMS)
    galleries = {"whole": (SIGNED, [*"aaba"], ()), "refused": (SIGNED, [*"aaba"], SIGNED[1:2])}
    yield "ranking", Component(partial(_called, stages.ranked, galleries))


def _of_method(name: str) -> Iterator[Part]:
    spec = select_one(name)
    for variant in [name, *(f"{name}[{variant}]" for variant in VARIANTS.get(name, ()))]:
        if spec.learns and "view" in spec.info.inputs:
            for image in ("woman", "man", "nothing", "tiny"):
                yield Part(
                    f"{variant}/{image}", stages.learned_form, (variant, inputs.depth_shape(image))
                )
            continue
        witnesses = ("large",) if variant == name and not spec.describes else ()
        for shape in (*SMALL, *LARGER, *witnesses):
            if spec.describes:
                yield Part(f"{variant}/{shape}", stages.descriptors_of, (variant, (shape,)))
            elif spec.learns:
                yield Part(
                    f"{variant}/{shape}", stages.learned_form, (variant, inputs.shape(shape))
                )
            else:
                yield Part(f"{variant}/{shape}", stages.form_of, (variant, shape))
        if spec.describes:
            yield Part(variant, stages.descriptors_of, (variant, SIGNED))


def _of_scorer(name: str) -> Iterator[Part]:
    for shape in (*SIGNED, "tetrahedron", "flat", "line"):
        yield Part(shape, stages.signature, (name, shape))
    if name == "cm-bof":
        yield Part("few-pixels", stages.signature, (f"{name}[image_size=48]", "small"))
        yield Part(
            "few-words", stages.compared, (f"{name}[n_words=12,allow_mirror=true]", SIGNED[1:3])
        )
    for variant in VARIANTS.get(name, ()):
        yield Part(variant, stages.signature, (f"{name}[{variant}]", "closed"))
        yield Part(f"{variant}/compared", stages.compared, (f"{name}[{variant}]", SIGNED))
    yield Part("compared", stages.compared, (name, SIGNED))


def _generated(name: str) -> Iterator[Part]:
    dataset = open_dataset(name, None)
    yield Part("all", stages.entries_of, (dataset,))
    for entry in (dataset.shapes[place] for place in GENERATED[name]):
        yield Part(entry.identifier, stages.mesh_of, (dataset, entry))
    if name == "humans-scanlike":
        yield Part("bodies", stages.bodies)


def _changed(name: str) -> Iterator[Part]:
    on_mesh = CHANGES[name].of_mesh if name != "jitter" else None
    for strength in STRENGTHS[: 2 if name == "jitter" else None]:
        yield Part(f"{strength}", stages.changed, (name, strength, 0))
    if on_mesh:
        yield Part("scan", stages.changed, (name, 3, 1))


def _called(call: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]) -> Iterator[Part]:
    return (Part(name, call, given) for name, given in arguments.items())

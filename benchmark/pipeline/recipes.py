"""Recipes of the stages of each shape: everything that determines a result, known before it is computed.

A recipe names the versions of all components that contribute to the result, including those of earlier stages; see
:mod:`benchmark.pipeline.storage.lock`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.changes import split_name
from benchmark.errors import ShapeError
from benchmark.geometry.camera import DepthSensor
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import read_lock, versions_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec

Recipe = dict[str, Any]

#: Component for the functions offered to plugins: geodesics, the Laplacian, eigenpairs.
OFFERED = "api"


def dataset_module(dataset: ShapeSet) -> str:
    """Return the module or plugin file that provides the meshes of a data set."""
    return dataset.code[0] if dataset.code else ""


def source_components(dataset: ShapeSet) -> list[str]:
    """Return the components that provide the meshes of a data set: readers or a generator, and changes in its name."""
    known = read_lock().components
    name, found = split_name(dataset.name)
    base = "data/frames" if dataset.observe else f"data/{name.partition('[')[0]}"
    if dataset.code and dataset.code[-1].endswith(".py"):
        base = OFFERED
    changes = [f"change/{change}" for change, _ in found]
    return [base if base in known else "data/files", *(change for change in changes if change in known)]


def preparation_components(dataset: ShapeSet, input_: Input) -> list[str]:
    """Return the components between the mesh or the depth frame and the prepared shape."""
    frame = ["preparation/frame"] if dataset.observe else []
    return [f"preparation/{input_}", *frame]


def method_components(spec: MethodSpec) -> list[str]:
    """Return the components between the prepared shape and the form, or the distances of a descriptor."""
    return [OFFERED if spec.is_foreign else f"method/{spec.base_name}"]


def scorer_components(spec: MethodSpec, scorer: ScorerSpec) -> list[str]:
    """Return the components between the form and the distances of a gallery; none for a descriptor."""
    return [] if spec.describes else [OFFERED if scorer.is_foreign else f"scorer/{scorer.base_name}"]


def job_versions(dataset: ShapeSet, input_: Input, spec: MethodSpec, scorer: ScorerSpec) -> dict[str, str]:
    """Return the versions of all components of a job by name."""
    return versions_of(
        [
            *source_components(dataset),
            *preparation_components(dataset, input_),
            *method_components(spec),
            *scorer_components(spec, scorer),
            "measures",
        ]
    )


def job_plugins(dataset: ShapeSet, spec: MethodSpec, scorer: ScorerSpec) -> Recipe:
    """Return the part of a recipe that names the sources of the plugins of a job; empty without plugins."""
    return _plugins(dataset, spec, *([] if spec.describes else [scorer]))


def _plugins(*plugins: Any) -> Recipe:
    """Return digests of plugin files with their imports, and versions of distributions; empty without foreign code."""
    sources = {name: source for plugin in plugins for name, source in getattr(plugin, "sources", {}).items()}
    return {"plugin": sources} if sources else {}


def _recipe(
    stage: str, components: Iterable[str], plugins: Iterable[Any] = (), after: Iterable[Recipe] = (), **parts: Any
) -> Recipe:
    """Return the recipe of a stage: its own entries, and the versions of its components and of all earlier ones."""
    versions = {name: version for recipe in after for name, version in recipe["versions"].items()}
    return {"stage": stage, **parts, "versions": versions | versions_of(components), **_plugins(*plugins)}


def source_recipe(dataset: ShapeSet, entry: Entry) -> Recipe:
    """Return the recipe of the mesh of a shape; it names the kind of error if the mesh cannot be read."""
    data = source_data(dataset, entry)
    return _recipe("source", source_components(dataset), [dataset], data=data)


def source_data(dataset: ShapeSet, entry: Entry) -> str:
    """Return the data set's recipe for the data of a shape, or the kind of error if they cannot be read."""
    try:
        return dataset.key(entry)
    except ShapeError as error:
        return type(error).__name__


def gallery_digest(entries: Iterable[Entry], data: Callable[[Entry], str]) -> str:
    """Return the digest of the shapes of a gallery, their classes, and the data of each."""
    return keys.digest([(entry.identifier, entry.subject, str(data(entry))) for entry in entries])


def frame_recipe(dataset: ShapeSet) -> Recipe:
    """Return the recipe of the scale of depth images: a constant, or all shapes of the data set."""
    if dataset.half_width is not None:
        return _recipe("frame", (), half_width=dataset.half_width)
    shapes = [(entry.identifier, source_data(dataset, entry), repr(dataset.camera(entry))) for entry in dataset.shapes]
    components = [*source_components(dataset), *preparation_components(dataset, "view")]
    return _recipe("frame", components, [dataset], shapes=keys.digest(shapes))


def shape_recipe(dataset: ShapeSet, entry: Entry, input_: Input, frame: Recipe) -> Recipe:
    """Return the recipe of the prepared shape.

    Parameters
    ----------
    dataset, entry, input_
        The shape.
    frame
        :func:`frame_recipe` of the data set; ignored for the mesh input.
    """
    source = source_recipe(dataset, entry)
    recipe = _recipe(input_, preparation_components(dataset, input_), after=[source], source=source)
    if input_ == "mesh":
        from benchmark.pipeline.stages.shapes import N_VERTICES

        return recipe | {"n_vertices": N_VERTICES}
    sensor = sensor_of(dataset, entry)
    perturbed = {} if sensor is None else {"sensor": repr(sensor)}
    return recipe | {"camera": repr(dataset.camera(entry)), "frame": frame} | perturbed


def sensor_of(dataset: ShapeSet, entry: Entry) -> DepthSensor | None:
    """Return the sensor whose errors are added to the depth images of a data set; None if it has none."""
    return dataset.sensor(entry)


def form_recipe(spec: MethodSpec, shape: Recipe, identifier: str, seed: int, model: str = "") -> Recipe:
    """Return the recipe of the canonical form or the descriptor.

    Parameters
    ----------
    spec
        The method.
    shape
        Recipe of the prepared shape.
    identifier
        Name of the shape, which may appear in the reason for a refusal.
    seed
        Base seed.
    model
        Digest of the weights of the trained model; "" if the method does not learn.
    """
    parts = {"shape": shape, "identifier": identifier, "method": spec.base_name, "seed": seed}
    parts |= {"parameters": spec.key_parameters(), **({"model": model} if model else {})}
    return _recipe("form", method_components(spec), [spec], [shape], **parts)


def features_recipe(form: Recipe, scorer: ScorerSpec) -> Recipe:
    """Return the recipe of the signature of a form."""
    components = [OFFERED if scorer.is_foreign else f"scorer/{scorer.base_name}"]
    return _recipe("features", components, [scorer], [form], form=form, scorer=_named(scorer))


def distances_recipe(forms: list[Recipe], spec: MethodSpec, scorer: ScorerSpec, draw: int | None) -> Recipe:
    """Return the recipe of the distances of a gallery: its forms or descriptors in order, and the scorer's draw."""
    parts = {"forms": forms, "scorer": _named(scorer), "codebook": draw}
    plugins = [] if spec.describes else [scorer]
    return _recipe("distances", scorer_components(spec, scorer), plugins, forms, **parts)


def draws_of(spec: MethodSpec, scorer: ScorerSpec) -> Sequence[int | None]:
    """Return the draws of the scorer for the distances of a gallery; a descriptor has the single draw None."""
    return (None,) if spec.describes else range(scorer.info.draws)


def scorer_recipe(scorer: ScorerSpec) -> Recipe:
    """Return the scorer as part of the recipe of a job; its draws are named as for the default scorer."""
    return {**_named(scorer), "codebooks": list(range(scorer.info.draws))}


def _named(scorer: ScorerSpec) -> Recipe:
    """Return the parameters of a scorer, and its name if it is not the default one."""
    name: Mapping[str, Any] = {} if scorer.base_name == DEFAULT else {"name": scorer.base_name}
    return {**scorer.key_parameters(), **name}

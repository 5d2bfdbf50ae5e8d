"""Recipes: what determines each stage of each shape, without computing it.

A recipe names the versions of all components that have a part in its result, those of earlier stages included; see
:mod:`benchmark.pipeline.storage.lock`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.depth_folder import DepthFolder
from benchmark.datasets.files import FolderDataset
from benchmark.datasets.own import OwnDataset
from benchmark.errors import ShapeError
from benchmark.geometry.camera import DepthSensor
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import read_lock, versions_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import DEFAULT, ScorerSpec

Recipe = dict[str, Any]

#: Component of what plugins are offered: geodesics, the Laplacian, eigenpairs.
OFFERED = "api"


def dataset_module(dataset: Dataset) -> str:
    """Module that makes the meshes of a data set; of one from a plugin file, the file."""
    return dataset.code if isinstance(dataset, OwnDataset) else type(dataset).__module__


def source_components(dataset: Dataset) -> list[str]:
    """Components that make the meshes of a data set: readers of files or a generator, and the changes in brackets."""
    known, original = read_lock().components, original_of(dataset)
    changes = [f"change/{name}" for name in re.findall(r"\[([a-z-]+)=", dataset.name)]
    if isinstance(original, OwnDataset):
        base = OFFERED
    elif isinstance(original, FolderDataset):
        base = "data/frames" if isinstance(original, DepthFolder) else "data/files"
    else:
        base = f"data/{original.name.partition('[')[0]}"
    return [base if base in known else "data/files", *(name for name in changes if name in known)]


def original_of(dataset: Dataset) -> Dataset:
    """Return the data set that a changed one is made of."""
    while (clean := getattr(dataset, "clean", None)) is not None:
        dataset = clean
    return dataset


def preparation_components(dataset: Dataset, input_: Input) -> list[str]:
    """Components between the mesh, or the depth frame, and the prepared shape."""
    frame = ["preparation/frame"] if isinstance(dataset, DepthFolder) else []
    return [f"preparation/{input_}", *frame]


def method_components(spec: MethodSpec) -> list[str]:
    """Components between the prepared shape and the form, or the distances of a descriptor."""
    return [OFFERED if spec.is_foreign else f"method/{spec.base_name}"]


def scorer_components(spec: MethodSpec, scorer: ScorerSpec) -> list[str]:
    """Components between the form and the distances of a gallery; none for a descriptor."""
    return [] if spec.describes else [OFFERED if scorer.is_foreign else f"scorer/{scorer.base_name}"]


def job_versions(dataset: Dataset, input_: Input, spec: MethodSpec, scorer: ScorerSpec) -> dict[str, str]:
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


def job_plugins(dataset: Dataset, spec: MethodSpec, scorer: ScorerSpec) -> Recipe:
    """Return the part of a recipe that names the sources of the plugins of a job; empty without plugins."""
    return _plugins(original_of(dataset), spec, *([] if spec.describes else [scorer]))


def _plugins(*plugins: Any) -> Recipe:
    """Digests of plugin files with what they import, and versions of distributions; empty where nothing is foreign."""
    sources = {name: source for plugin in plugins for name, source in getattr(plugin, "sources", {}).items()}
    return {"plugin": sources} if sources else {}


def _recipe(
    stage: str, components: Iterable[str], plugins: Iterable[Any] = (), after: Iterable[Recipe] = (), **parts: Any
) -> Recipe:
    """Return the recipe of a stage: what is peculiar to it, and the versions of its components and of all before."""
    versions = {name: version for recipe in after for name, version in recipe["versions"].items()}
    return {"stage": stage, **parts, "versions": versions | versions_of(components), **_plugins(*plugins)}


def source_recipe(dataset: Dataset, entry: Entry) -> Recipe:
    """Return what determines the mesh of a shape; for one that cannot be read, the kind of error."""
    data = source_data(dataset, entry)
    return _recipe("source", source_components(dataset), [original_of(dataset)], data=data)


def source_data(dataset: Dataset, entry: Entry) -> str:
    """Return what a data set tells of the data of a shape; for one that cannot be read, the kind of error."""
    try:
        return dataset.recipe(entry)
    except ShapeError as error:
        return type(error).__name__


def frame_recipe(dataset: Dataset) -> Recipe:
    """Return what determines the scale of the depth images: a constant, or all shapes of the set."""
    if dataset.half_width is not None:
        return _recipe("frame", (), half_width=dataset.half_width)
    shapes = [(entry.identifier, source_data(dataset, entry), repr(dataset.camera(entry))) for entry in dataset.entries]
    components = [*source_components(dataset), *preparation_components(dataset, "view")]
    return _recipe("frame", components, [original_of(dataset)], shapes=keys.digest(shapes))


def shape_recipe(dataset: Dataset, entry: Entry, input_: Input, frame: Recipe) -> Recipe:
    """Return what determines the prepared shape.

    Parameters
    ----------
    dataset, entry, input_
        The shape.
    frame
        :func:`frame_recipe` of the data set; of no account for the mesh input.
    """
    source = source_recipe(dataset, entry)
    recipe = _recipe(input_, preparation_components(dataset, input_), after=[source], source=source)
    if input_ == "mesh":
        from benchmark.pipeline.stages.complete import N_VERTICES

        return recipe | {"n_vertices": N_VERTICES}
    sensor = sensor_of(dataset, entry)
    perturbed = {} if sensor is None else {"sensor": repr(sensor)}
    return recipe | {"camera": repr(dataset.camera(entry)), "frame": frame} | perturbed


def sensor_of(dataset: Dataset, entry: Entry) -> DepthSensor | None:
    """Return the sensor of a data set, which adds faults to its depth images; None where it says nothing of one."""
    sensor = getattr(dataset, "sensor", None)
    return sensor(entry) if sensor else None


def form_recipe(spec: MethodSpec, shape: Recipe, identifier: str, seed: int, model: str = "") -> Recipe:
    """Return what determines the canonical form, or the descriptor.

    Parameters
    ----------
    spec
        The method.
    shape
        Recipe of the prepared shape.
    identifier
        Name of the shape, which the reason of a refusal may hold.
    seed
        Base seed.
    model
        Digest of the weights of the trained model; "" where the method does not learn.
    """
    parts = {"shape": shape, "identifier": identifier, "method": spec.base_name, "seed": seed}
    parts |= {"parameters": spec.key_parameters(), **({"model": model} if model else {})}
    return _recipe("form", method_components(spec), [spec], [shape], **parts)


def features_recipe(form: Recipe, scorer: ScorerSpec) -> Recipe:
    """Return what determines the signature of a form."""
    components = [OFFERED if scorer.is_foreign else f"scorer/{scorer.base_name}"]
    return _recipe("features", components, [scorer], [form], form=form, scorer=_named(scorer))


def distances_recipe(forms: list[Recipe], spec: MethodSpec, scorer: ScorerSpec, draw: int | None) -> Recipe:
    """Return the recipe of the distances of a gallery: its forms or descriptors in order, and the scorer's draw."""
    parts = {"forms": forms, "scorer": _named(scorer), "codebook": draw}
    plugins = [] if spec.describes else [scorer]
    return _recipe("distances", scorer_components(spec, scorer), plugins, forms, **parts)


def draws_of(spec: MethodSpec, scorer: ScorerSpec) -> Sequence[int | None]:
    """Return the draws of the scorer that a gallery has distances under; one without a number for a descriptor."""
    return (None,) if spec.describes else range(scorer.info.draws)


def scorer_recipe(scorer: ScorerSpec) -> Recipe:
    """The scorer as part of the recipe of a job; the draws go by the name that they have for the default one."""
    return {**_named(scorer), "codebooks": list(range(scorer.info.draws))}


def _named(scorer: ScorerSpec) -> Recipe:
    """Parameters of a scorer, and its name where it is not the default one."""
    name: Mapping[str, Any] = {} if scorer.base_name == DEFAULT else {"name": scorer.base_name}
    return {**scorer.key_parameters(), **name}

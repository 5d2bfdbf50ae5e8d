"""Recipes: what determines each stage of each shape, without computing it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.own import OwnDataset
from benchmark.errors import ShapeError
from benchmark.geometry.camera import DepthSensor
from benchmark.methods.registry import MethodSpec
from benchmark.methods.scorers import DEFAULT, ScorerSpec
from benchmark.storage import keys
from benchmark.system import fingerprints

Recipe = dict[str, Any]

_STAGES = "benchmark.jobs.stages"

#: Module of the stage that prepares a shape for each input.
PREPARATION: dict[Input, str] = {"mesh": f"{_STAGES}.complete", "view": f"{_STAGES}.view"}

#: What a learner's own training imports, and the look at its options before it, cannot change a form that a finished
#: model makes.
_NOT_FOR_FORMS = ("train", "check_options")


def dataset_module(dataset: Dataset) -> str:
    """Module that makes the meshes of a data set; of one from a plugin file, the file."""
    return dataset.code if isinstance(dataset, OwnDataset) else type(dataset).__module__


def source_code(module: str) -> fingerprints.Fingerprint:
    """Code that makes the meshes of a data set, by its module: readers of files, a generator, or a plugin file."""
    return fingerprints.fingerprint(module, *([OwnDataset.__module__] if module.endswith(".py") else []))


def preparation_code(input_: Input) -> fingerprints.Fingerprint:
    """Code between the mesh and the prepared shape."""
    return fingerprints.fingerprint(PREPARATION[input_])


def method_code(spec: MethodSpec) -> fingerprints.Fingerprint:
    """Code between the prepared shape and the form."""
    return fingerprints.fingerprint(spec.module, *spec.inherited, f"{_STAGES}.form", without=_NOT_FOR_FORMS)


def training_code(spec: MethodSpec) -> dict[str, str]:
    """Return the fingerprints of the modules that only the training of a learner imports; they make no form."""
    of_forms = method_code(spec).code
    return {name: text for name, text in fingerprints.fingerprint(spec.module).code.items() if name not in of_forms}


def features_code(scorer: ScorerSpec) -> fingerprints.Fingerprint:
    """Code between the form and its signature."""
    return fingerprints.fingerprint(scorer.module, f"{_STAGES}.features")


def distances_code(scorer: ScorerSpec) -> fingerprints.Fingerprint:
    """Code between the forms and the distances of a gallery."""
    index = (scorer.index_module, "retrieval.neighbours") if scorer.neighbours else (f"{_STAGES}.distances",)
    return fingerprints.fingerprint(scorer.module, f"{_STAGES}.features", *index)


def measures_code() -> fingerprints.Fingerprint:
    """Code between the distances and the measures of a gallery."""
    return fingerprints.fingerprint(f"{_STAGES}.measures")


def nearest_code() -> fingerprints.Fingerprint:
    """Code between the nearest shapes and the measures of a gallery."""
    return fingerprints.fingerprint(f"{_STAGES}.neighbours")


def source_recipe(dataset: Dataset, entry: Entry) -> Recipe:
    """Return what determines the mesh of a shape; for one that cannot be read, the kind of error."""
    code = source_code(dataset_module(dataset)).digest
    return {"stage": "source", "data": source_data(dataset, entry), "code": code}


def source_data(dataset: Dataset, entry: Entry) -> str:
    """Return what a data set tells of the data of a shape; for one that cannot be read, the kind of error."""
    try:
        return dataset.recipe(entry)
    except ShapeError as error:
        return type(error).__name__


def frame_recipe(dataset: Dataset) -> Recipe:
    """Return what determines the scale of the depth images: a constant, or all shapes of the set."""
    if dataset.half_width is not None:
        return {"stage": "frame", "half_width": dataset.half_width}
    shapes = [
        (entry.identifier, source_recipe(dataset, entry), repr(dataset.camera(entry))) for entry in dataset.entries
    ]
    return {"stage": "frame", "shapes": keys.digest(shapes), "code": preparation_code("view").digest}


def shape_recipe(dataset: Dataset, entry: Entry, input_: Input, frame: Recipe) -> Recipe:
    """Return what determines the prepared shape.

    Parameters
    ----------
    dataset, entry, input_
        The shape.
    frame
        :func:`frame_recipe` of the data set; of no account for the mesh input.
    """
    recipe = {"stage": input_, "source": source_recipe(dataset, entry), "code": preparation_code(input_).digest}
    if input_ == "mesh":
        from benchmark.jobs.stages.complete import N_VERTICES

        return recipe | {"n_vertices": N_VERTICES}
    sensor = sensor_of(dataset, entry)
    perturbed = {} if sensor is None else {"sensor": repr(sensor)}
    return recipe | {"camera": repr(dataset.camera(entry)), "frame": frame} | perturbed


def sensor_of(dataset: Dataset, entry: Entry) -> DepthSensor | None:
    """Return the sensor of a data set, which adds faults to its depth images; None where it says nothing of one."""
    found = getattr(dataset, "sensor", None)
    return found(entry) if found else None


def form_recipe(spec: MethodSpec, shape: Recipe, identifier: str, seed: int, model: str = "") -> Recipe:
    """Return what determines the canonical form, or the descriptor.

    Parameters
    ----------
    spec
        The method.
    shape
        Recipe of the prepared shape.
    identifier
        Name of the shape; random choices depend on it.
    seed
        Base seed.
    model
        Digest of the trained model; "" where the method does not learn.
    """
    recipe = {
        "stage": "form",
        "shape": shape,
        "identifier": identifier,
        "method": spec.base_name,
        "parameters": spec.resolved_parameters(),
        "seed": seed,
        "code": method_code(spec).digest,
    }
    return recipe | ({"model": model} if model else {})


def features_recipe(form: Recipe, scorer: ScorerSpec) -> Recipe:
    """Return what determines the signature of a form."""
    return {
        "stage": "features",
        "form": form,
        "scorer": _named(scorer),
        "code": features_code(scorer).digest,
    }


def distances_recipe(forms: list[Recipe], scorer: ScorerSpec, draw: int | None) -> Recipe:
    """Return the recipe of the distances of a gallery: its forms or descriptors in order, and the scorer's draw."""
    return {
        "stage": "distances",
        "forms": forms,
        "scorer": _named(scorer),
        "codebook": draw,
        "code": distances_code(scorer).digest,
        **_neighbours(scorer),
    }


def index_recipe(distances: Recipe) -> Recipe:
    """Return the recipe of the index that the neighbours of a gallery come from, however many are looked for."""
    return {name: part for name, part in distances.items() if name != "neighbours"} | {"stage": "index"}


def draws_of(spec: MethodSpec, scorer: ScorerSpec) -> Sequence[int | None]:
    """Return the draws of the scorer that a gallery has distances under; one without a number for a descriptor."""
    return (None,) if spec.describes else range(scorer.info.draws)


def scorer_recipe(scorer: ScorerSpec) -> Recipe:
    """The scorer as part of the recipe of a job; the draws go by the name that they have for the default one."""
    return {**_named(scorer), "codebooks": list(range(scorer.info.draws)), **_neighbours(scorer)}


def _neighbours(scorer: ScorerSpec) -> Recipe:
    """Return the part of a recipe that names the neighbours; empty where all pairs are compared."""
    return {"neighbours": scorer.neighbours} if scorer.neighbours else {}


def _named(scorer: ScorerSpec) -> Recipe:
    """Parameters of a scorer, and its name where it is not the default one."""
    name = {} if scorer.base_name == DEFAULT else {"name": scorer.base_name}
    return {**scorer.resolved_parameters(), **name}


def job_code(source: str, input_: Input, spec: MethodSpec, scorer: ScorerSpec) -> dict[str, dict[str, dict[str, str]]]:
    """Fingerprints of all stages of a job, so that a plan can name what changed.

    Parameters
    ----------
    source
        :func:`dataset_module` of the data set.
    input_, spec, scorer
        The job.
    """
    return {
        "source": source_code(source).plain(),
        "preparation": preparation_code(input_).plain(),
        "method": method_code(spec).plain(),
        "scorer": distances_code(scorer).plain(),
        "measures": (nearest_code() if scorer.neighbours else measures_code()).plain(),
    }

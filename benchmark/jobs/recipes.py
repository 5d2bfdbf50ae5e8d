"""What determines each stage of each shape, without computing it."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

from benchmark.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.errors import ShapeError
from benchmark.jobs.stages.complete import N_VERTICES
from benchmark.jobs.stages.ranking import CODEBOOK_SEEDS
from benchmark.methods.registry import MethodSpec
from benchmark.storage import keys
from benchmark.system import fingerprints
from retrieval.cmbof import CMBOF

Recipe = dict[str, Any]

_STAGES = "benchmark.jobs.stages"

#: Module of the stage that prepares a shape for each input.
PREPARATION: dict[Input, str] = {"mesh": f"{_STAGES}.complete", "view": f"{_STAGES}.view"}

#: What a learner's own training imports, and the look at its options before it, cannot change a form that a finished
#: model makes.
_NOT_FOR_FORMS = ("train", "check_options")


def dataset_module(dataset: Dataset) -> str:
    """Module that makes the meshes of a data set."""
    return type(dataset).__module__


def source_code(module: str) -> fingerprints.Fingerprint:
    """Code that makes the meshes of a data set, by its module: the readers of files, or the generator."""
    return fingerprints.fingerprint(module)


def preparation_code(input_: Input) -> fingerprints.Fingerprint:
    """Code between the mesh and the prepared shape."""
    return fingerprints.fingerprint(PREPARATION[input_])


def method_code(spec: MethodSpec) -> fingerprints.Fingerprint:
    """Code between the prepared shape and the form."""
    # A class made by a decorator or inherited from elsewhere brings the code of its bases along.
    modules = [base.__module__ for base in inspect.getmro(spec.load())[1:] if base.__module__ != "builtins"]
    inherited = [name for name in dict.fromkeys(modules) if name.partition(".")[0] in fingerprints.FIRST_PARTY]
    return fingerprints.fingerprint(spec.module, *inherited, f"{_STAGES}.form", without=_NOT_FOR_FORMS)


def features_code() -> fingerprints.Fingerprint:
    """Code between the form and its features."""
    return fingerprints.fingerprint(f"{_STAGES}.features")


def ranking_code() -> fingerprints.Fingerprint:
    """Code between the features of a gallery and its measures."""
    return fingerprints.fingerprint(f"{_STAGES}.ranking")


def source_recipe(dataset: Dataset, entry: Entry) -> Recipe:
    """What determines the mesh of a shape; for one that cannot be read, the reason."""
    try:
        data = dataset.recipe(entry)
    except ShapeError as error:
        data = str(error)
    return {"stage": "source", "data": data, "code": source_code(dataset_module(dataset)).digest}


def frame_recipe(dataset: Dataset) -> Recipe:
    """What determines the scale of the depth images: a constant, or all shapes of the set."""
    if dataset.half_width is not None:
        return {"stage": "frame", "half_width": dataset.half_width}
    shapes = [
        (entry.identifier, source_recipe(dataset, entry), repr(dataset.camera(entry))) for entry in dataset.entries
    ]
    return {"stage": "frame", "shapes": keys.digest(shapes), "code": preparation_code("view").digest}


def shape_recipe(dataset: Dataset, entry: Entry, input_: Input, frame: Recipe) -> Recipe:
    """What determines the prepared shape.

    Parameters
    ----------
    dataset, entry, input_
        The shape.
    frame
        :func:`frame_recipe` of the data set; of no account for the mesh input.
    """
    recipe = {"stage": input_, "source": source_recipe(dataset, entry), "code": preparation_code(input_).digest}
    if input_ == "mesh":
        return recipe | {"n_vertices": N_VERTICES}
    return recipe | {"camera": repr(dataset.camera(entry)), "frame": frame}


def form_recipe(spec: MethodSpec, shape: Recipe, identifier: str, seed: int, model: str = "") -> Recipe:
    """What determines the canonical form, or the descriptor.

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


def features_recipe(form: Recipe, scorer: CMBOF) -> Recipe:
    """What determines the features of a form."""
    return {
        "stage": "features",
        "form": form,
        "scorer": dataclasses.asdict(scorer),
        "code": features_code().digest,
    }


def distances_recipe(forms: list[Recipe], scorer: CMBOF, codebook: int | None) -> Recipe:
    """What determines the distances of a gallery: its forms or descriptors in order, and the seed of the codebook."""
    return {
        "stage": "distances",
        "forms": forms,
        "scorer": dataclasses.asdict(scorer),
        "codebook": codebook,
        "code": [features_code().digest, ranking_code().digest],
    }


def scorer_recipe(scorer: CMBOF) -> Recipe:
    """The scorer as part of the recipe of a job."""
    return {**dataclasses.asdict(scorer), "codebooks": list(CODEBOOK_SEEDS)}


def job_code(source: str, input_: Input, spec: MethodSpec) -> dict[str, dict[str, dict[str, str]]]:
    """Fingerprints of all stages of a job, so that a plan can name what changed.

    Parameters
    ----------
    source
        :func:`dataset_module` of the data set.
    input_, spec
        The job.
    """
    return {
        "source": source_code(source).plain(),
        "preparation": preparation_code(input_).plain(),
        "method": method_code(spec).plain(),
        "scorer": fingerprints.fingerprint(f"{_STAGES}.features", f"{_STAGES}.ranking").plain(),
    }

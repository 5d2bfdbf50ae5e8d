"""Calls into the suite that golden results need; each function returns named arrays, or raises a
refusal.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas

from benchmark.api.contracts import Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.code_digest import digest
from benchmark.datasets.bodies import POSES, SUBJECTS, body_mesh
from benchmark.datasets.changes import with_change
from benchmark.datasets.people import _SCANNED_POSES
from benchmark.depth import frame, intrinsics, reading
from benchmark.geometry.camera import SIDE, DepthSensor
from benchmark.pipeline.cache import Cache
from benchmark.pipeline.forms import SharedResults
from benchmark.pipeline.outputs import (
    compute_distances,
    compute_output,
    compute_signature,
    make_distance_check,
)
from benchmark.pipeline.ranking import rank
from benchmark.pipeline.records import Data, Record
from benchmark.pipeline.stages import MACHINE, REFUSED, SECONDS, require_result
from benchmark.pipeline.surfaces import prepare_mesh
from benchmark.pipeline.views import fit_frame, prepare_view
from benchmark.registry import select_one
from tests.golden import inputs

Arrays = Mapping[str, Any]


def form_of(name: str, shape: str) -> Arrays:
    """Return a form in double precision, before the stage rounds it, with notes of the stage."""
    return _form_of(select_one(name).create(), inputs.shape(shape))


def learned_form(name: str, shape: Shape) -> Arrays:
    """Return a form by a network whose weights follow a formula."""
    return _form_of(_trained(name)[0], shape)


def _form_of(method: Any, shape: Shape) -> Arrays:
    canonicalise, forms = type(method).canonicalise, []

    def noted(self: Any, shape: Shape) -> Any:
        forms.append(canonicalise(self, shape))
        return forms[-1]

    with patch.object(type(method), "canonicalise", noted):
        formed = _answer(method, shape)
    return {
        **formed,
        "vertices": forms[-1].vertices,
        "digits": formed["vertices"].dtype.str,
    }


def _answer(method: Any, shape: Shape) -> Arrays:
    """Return a form or a descriptor without times and machine; raise the reason of a refusal."""
    answer = require_result(compute_output(method, shape, SharedResults()))
    return {
        name: array for name, array in answer.items() if not name.startswith((SECONDS, MACHINE))
    }


@cache
def _trained(name: str) -> tuple[Any, Any]:
    """Return a learner with its model, and the folder of the model, which lasts as long as the
    process.
    """
    method: Any = select_one(name).create()
    models = tempfile.TemporaryDirectory()
    inputs.write_model(method, Path(models.name) / "model")
    return method.load(Path(models.name) / "model"), models


def descriptors_of(name: str, names: Sequence[str]) -> Arrays:
    """Return descriptors of shapes, and the distances between them."""
    method: Any = select_one(name).create()
    descriptors = [_answer(method, inputs.shape(shape))["descriptor"] for shape in names]
    return {
        **dict(zip(names, descriptors, strict=True)),
        "distances": compute_distances(method, descriptors),
    }


def signature(name: str, shape: str) -> Arrays:
    """Return the signature of a form."""
    return compute_signature(select_one(name, kind="scorer").create(), inputs.mesh("shapes", shape))


def compared(name: str, forms: Sequence[str]) -> Arrays:
    """Return the distances between committed signatures for each draw."""
    scorer = select_one(name, kind="scorer").create()
    signatures = [_committed(name.partition("[")[0], form) for form in forms]
    return {f"draw-{n}": compute_distances(scorer, signatures, n) for n in range(scorer.info.draws)}


def _committed(scorer: str, form: str) -> Arrays:
    """Return a committed signature."""
    stored = inputs.arrays("signatures")
    return {
        key.rpartition("/")[2]: value
        for key, value in stored.items()
        if key.startswith(f"{scorer}/{form}/")
    }


def ranked(forms: Sequence[str], labels: Sequence[str], refused: Sequence[str]) -> Arrays:
    """Return what the record of a gallery of committed signatures says; some shapes are refused."""
    scorer = select_one("cm-bof", kind="scorer").create()
    keys = [digest(form) for form in forms]
    record = Record(
        key=digest(forms),
        status="unavailable",
        gallery="",
        gallery_digest="",
        input="mesh",
        method="",
        title="",
        family="",
        data=Data("", "", ""),
        shapes=list(forms),
        labels=list(labels),
        files={"prepared": keys, "forms": keys, "signatures": keys},
    )
    with tempfile.TemporaryDirectory() as folder:
        cache, second = Cache(Path(folder)), {SECONDS: np.ones(2)}
        for form, key in zip(forms, keys, strict=True):
            cache.write("prepared", key, {**second, "note:bridges": np.array(len(form))})
            cache.write(
                "forms", key, {REFUSED: np.array(["no reason", ""])} if form in refused else second
            )
            cache.write("signatures", key, {**_committed("cm-bof", form), **second})
        content, arrays = rank(record, cache, scorer, make_distance_check(scorer))
    del content["machines"]
    del content["processor_seconds"], content["seconds"]["ranking"]  # of this machine
    refused = [forms.index(name) for name, _ in content.pop("unsupported")]
    return {**arrays, **_flat({**content, "unsupported": refused})}


def completed(name: str) -> Arrays:
    """Return a raw mesh, prepared."""
    return prepare_mesh(inputs.mesh("raw", name))


def seen(name: str, half_width: float | None, sensor: DepthSensor | None = None) -> Arrays:
    """Return the view of a raw mesh from the side, in a given frame or in its own."""
    source = inputs.mesh("raw", name)
    width = fit_frame(source, SIDE) if half_width is None else half_width
    rendered = prepare_view(source, SIDE, width, sensor)
    return {**rendered, "depth": rendered["depth"][::10, ::10], "half_width": width}


def observed(given: bool, up: tuple[float, ...] | None, floor: bool = True) -> Arrays:
    """Return the view of the object in a depth frame."""
    stored = inputs.arrays("frame")
    depth = stored["depth"] if floor else np.where(stored["mask"], stored["depth"], 0)
    height, width = depth.shape  # a part of an image, so that its centre is that of no whole one
    camera = intrinsics.Intrinsics(*stored["camera"], size=(width, height))
    seen_object = frame.observe(
        reading.in_metres(depth), camera, stored["mask"] if given else None, up
    )
    prepared = prepare_view(seen_object.surface, frame.UPRIGHT, frame.HALF_WIDTH)
    notes = {f"seen:{key}": value for key, value in seen_object.notes.items()}
    return {**prepared, "depth": prepared["depth"][::10, ::10], **notes}


def entries_of(dataset: ShapeSet) -> Arrays:
    """Return the description of the shapes of a data set."""
    sensor = dataset.sensor
    lines = [
        f"{e.identifier} {e.subject} {e.pose} {dataset.camera(e)} {sensor(e) or ''}".strip()
        for e in dataset.shapes
    ]
    return {
        "entries": lines,
        "about": f"{dataset.name} {dataset.half_width} {dataset.stand_in_for}",
    }


def mesh_of(dataset: ShapeSet, entry: Entry, step: int = 100) -> Arrays:
    """Return some vertices, and all faces, of a shape of a data set."""
    mesh = dataset.load(entry)
    return {"vertices": mesh.vertices[::step], "faces": mesh.faces, "count": mesh.n_vertices}


def bodies() -> Arrays:
    """Return every body before it is scanned, each in one pose, with every pose of the scans."""
    adults = SUBJECTS["humans-scanlike"].values()
    meshes = [
        body_mesh(body, POSES[_SCANNED_POSES[n % len(_SCANNED_POSES)]])
        for n, body in enumerate(adults)
    ]
    return {"bodies": [body.vertices[::500] for body in meshes]}


def changed(change: str, value: Any, place: int) -> Arrays:
    """Return a committed mesh after a change of its data set, and its camera."""
    dataset = with_change(inputs.committed_meshes(), change, value)
    entry = dataset.shapes[place]
    camera, sensor = dataset.camera(entry), dataset.sensor(entry)
    image = {"image": sensor.perturbed(np.linspace(0, 1, 60).reshape(6, 10))} if sensor else {}
    return {**mesh_of(dataset, entry, 25), "camera": [*camera.direction, *camera.up], **image}


def _flat(nested: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of nested dictionaries by path; NaN marks a query without a measure."""
    (flat,) = pandas.json_normalize(dict(nested)).to_dict("records")
    return {
        str(key): np.array(value, float) if isinstance(value, list) else value
        for key, value in flat.items()
    }

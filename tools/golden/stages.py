"""What golden results call of the suite, all in one place: each function returns named arrays, or raises a refusal."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.contracts import Mesh, Shape
from benchmark.datasets.base import Dataset, Entry
from benchmark.geometry.camera import SIDE, DepthSensor
from benchmark.jobs.stages import complete, distances, features, form, measures, view
from benchmark.methods.registry import methods, variant
from benchmark.methods.scorers import scorer_of, scorers
from tools.golden import inputs

Arrays = Mapping[str, Any]


# Methods -------------------------------------------------------------------------------------------------------------


def form_of(name: str, shape: str) -> Arrays:
    """Form in double, before the stage rounds it, and what the stage says of it."""
    method: Any = variant(name, methods()).create()
    given = inputs.shape(shape)
    found = form.canonicalise(method, given)
    return {**found, "vertices": method.canonicalise(given).vertices, "digits": found["vertices"].dtype.str}


def descriptors_of(name: str, shapes: Sequence[str]) -> Arrays:
    """Descriptors of shapes, and the distances between them."""
    method: Any = variant(name, methods()).create()
    found = [form.describe(method, inputs.shape(shape))["descriptor"] for shape in shapes]
    return {**dict(zip(shapes, found, strict=True)), "distances": distances.descriptor_distances(method, found)}


def learned_form(name: str, given: Shape) -> Arrays:
    """Form by a network whose weights follow a formula."""
    method, _ = _trained(name)
    return {**form.canonicalise(method, given), "vertices": method.canonicalise(given).vertices}


@cache
def _trained(name: str) -> tuple[Any, Any]:
    """A learner with its model, and the folder of the latter, which lasts as long as the process."""
    method: Any = variant(name, methods()).create()
    folder = tempfile.TemporaryDirectory()
    inputs.write_model(*_network(method), Path(folder.name) / "model")
    return method.load(Path(folder.name) / "model"), folder


def _network(method: Any) -> tuple[Any, dict[str, Any]]:
    """The network of a learner as built, and its card."""
    package = type(method).__module__.split(".")[1]
    if package == "field":
        from learned.field.configuration import field_named
        from learned.field.network import build_field

        return build_field(field_named(method.configuration)), {"field": field_named(method.configuration).described()}
    if package == "streamed":
        from learned.streamed.configuration import streamed
        from learned.streamed.network import build_streamed

        described = streamed(method.configuration).described()
        return build_streamed(streamed(method.configuration)), {"streamed": described}
    from learned.paired.card import _TOLD
    from learned.paired.configuration import configuration
    from learned.paired.network import build

    chosen = configuration(method.configuration)
    blank = {
        key: (1 if kind is int else kind[0]() if isinstance(kind, tuple) else kind()) for key, kind in _TOLD.items()
    }
    return build(chosen), {**blank, "configuration": chosen.described(), "schedule": {"resolution": 128}}


# Scorers -------------------------------------------------------------------------------------------------------------


def signature_of(name: str, shape: str) -> Arrays:
    """Signature of a form."""
    return features.extract(scorer_of(name, scorers()).create(), inputs.mesh("shapes", shape))


def compared(name: str, forms: Sequence[str]) -> Arrays:
    """Distances between committed signatures under each draw."""
    scorer = scorer_of(name, scorers()).create()
    base, stored = name.partition("[")[0], inputs.arrays("signatures")
    signatures = [
        {key.rpartition("/")[2]: value for key, value in stored.items() if key.startswith(f"{base}/{each}/")}
        for each in forms
    ]
    return {f"draw-{n}": distances.form_distances(scorer, signatures, n) for n in range(scorer.info.draws)}


# Preparation ---------------------------------------------------------------------------------------------------------


def completed(name: str) -> Arrays:
    return complete.complete(inputs.mesh("raw", name))


def seen(name: str, half_width: float | None, sensor: DepthSensor | None = None) -> Arrays:
    """View of a raw mesh from the side, in a given frame or in its own."""
    source = inputs.mesh("raw", name)
    frame = view.frame_of([view.half_width_of(source, SIDE)]) if half_width is None else half_width
    found = dict(view.seen(source, SIDE, frame, sensor))
    return found | {"depth": found["depth"][::10, ::10], "half_width": np.asarray(frame)}


def observed(mask: bool, up: tuple[float, ...] | None, floor: bool = True) -> Arrays:
    """View of the object of a depth frame."""
    from benchmark.depth.frame import observe
    from benchmark.depth.intrinsics import Intrinsics
    from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
    from benchmark.depth.reading import in_metres

    frame = inputs.arrays("frame")
    depth = frame["depth"] if floor else np.where(frame["mask"], frame["depth"], 0)
    found = observe(in_metres(depth), Intrinsics(*frame["camera"]), frame["mask"] if mask else None, up)
    prepared = dict(view.seen(found.surface, UPRIGHT, HALF_WIDTH))
    return {
        **prepared,
        "depth": prepared["depth"][::10, ::10],
        **{f"seen:{key}": np.asarray(value) for key, value in found.notes.items()},
    }


# What benchmark.api offers -------------------------------------------------------------------------------------------


def geodesics(shape: str, solver: str) -> Arrays:
    given = inputs.shape(shape)
    return {"all": given.geodesics(solver)[::29], "few": given.geodesics_from([0, 3], solver)}


def laplacian(shape: str) -> Arrays:
    from benchmark.geometry.laplacian import eigenpairs

    found = inputs.shape(shape).laplacian()
    values, functions = eigenpairs(found, 12)
    stiffness = found.stiffness.tocoo()
    # The sign of a function is arbitrary.
    return {"stiffness": stiffness.data, "mass": found.mass, "eigenvalues": values, "functions": np.abs(functions)}


def draws() -> Arrays:
    return {"draws": inputs.shape("small").random("golden").standard_normal(9)}


# Data sets -----------------------------------------------------------------------------------------------------------


def entries_of(dataset: Dataset) -> Arrays:
    sensor = getattr(dataset, "sensor", lambda _: "")
    lines = [
        f"{e.identifier} {e.subject} {e.pose} {dataset.camera(e)} {sensor(e) or ''}".strip() for e in dataset.entries
    ]
    return {"entries": np.array(lines), "about": f"{dataset.name} {dataset.half_width} {dataset.stand_in_for}"}


def random_bodies() -> Arrays:
    """Phenotypes of all draws of random subjects."""
    from benchmark.datasets.human_subjects import RANDOM_SUBJECTS

    return {f"draw-{n}": np.array([astuple(s) for s in drawn.values()]) for n, drawn in enumerate(RANDOM_SUBJECTS)}


def mesh_of(dataset: Dataset, entry: Entry) -> Arrays:
    return _thin(dataset.load(entry), 100)


def humans_gallery() -> Arrays:
    from benchmark.datasets.catalogue import open_dataset

    dataset = open_dataset("humans[subjects=30,poses=3]", None)
    return {**entries_of(dataset), **mesh_of(dataset, dataset.entries[-2])}


def adult_bodies() -> Arrays:
    """Every body that is scanned, before that, and every pose."""
    from benchmark.datasets.human_poses import POSES
    from benchmark.datasets.human_subjects import adults
    from benchmark.datasets.humans import human_mesh
    from benchmark.datasets.humans_scanlike import POSE_NAMES

    poses = [POSES[name] for name in POSE_NAMES]
    bodies = [human_mesh(body, poses[n % len(poses)]) for n, body in enumerate(adults().values())]
    return {"bodies": np.array([body.vertices[::500] for body in bodies])}


def animal_skeletons() -> Arrays:
    """Bones of every animal in every pose."""
    from benchmark.datasets.animals.generate import SPECIES
    from benchmark.datasets.animals.poses import POSES
    from benchmark.datasets.animals.skeleton import Skeleton

    found: dict[str, Any] = {}
    for name, poses in POSES.items():
        skeleton = Skeleton.of(SPECIES[name])
        for pose, aims in poses.items():
            rotations, translations = skeleton.transforms(aims)
            found[f"{name}/{pose}"] = np.concatenate([rotations.as_matrix().reshape(-1, 9), translations], axis=1)
    return found


def sampled(name: str) -> Arrays:
    """A body or two of each stream that networks are trained on."""
    from benchmark.datasets.humans import human_meshes, sample_human
    from benchmark.datasets.scans.sampler import ScanSampler
    from benchmark.datasets.varied.sampler import Sampler
    from benchmark.datasets.varied.wide import WideSampler
    from benchmark.datasets.varied_animals import AnimalSampler

    if name in ("varied", "wide"):
        sampler = Sampler(0) if name == "varied" else WideSampler(seed=0, views=2)
        fresh, body = vars(sampler(0, 1, 64)), vars(Sampler(0).surfaces(1, 1))
        images = {key: fresh[key][..., ::3, ::3] for key in ("images", "fronts", "backs")}
        points = {key: fresh[key] for key in ("pixels", "places", "points") if fresh[key] is not None}
        return {**images, **points, "posed": body["posed"][0, :, ::100], "canonical": body["canonical"][0, ::100]}
    if name == "scans":
        (scan, *_) = ScanSampler(seed=0)(0, 1).scans[0]
        return {**_thin(scan.mesh, 50), "corners": scan.corners, "weights": scan.weights[::50]}
    if name == "animals":
        species, meshes = AnimalSampler(2, 3)(0, 0)
        return {"species": species, "bodies": np.array([mesh.vertices[::100] for mesh in meshes])}
    body, poses = sample_human(0, 6, seed=0)
    return {"bodies": np.array([mesh.vertices[::200] for mesh in human_meshes((body, pose) for pose in poses)])}


def _thin(mesh: Mesh, step: int) -> Arrays:
    return {"vertices": mesh.vertices[::step], "faces": mesh.faces, "count": mesh.n_vertices}


def changed(name: str, entry: int) -> Arrays:
    """A committed mesh under a change, written as in the brackets of a data set."""
    from benchmark.datasets.decimated import Decimated
    from benchmark.datasets.jittered import Jittered
    from benchmark.datasets.perturbations.frames import perturbed

    change, _, value = name.partition("=")
    clean = inputs.CommittedMeshes()
    makers: dict[str, Any] = {
        "jitter": lambda: Jittered(clean, int(value)),
        "decimation": lambda: Decimated.of(clean, value),
    }
    dataset = makers.get(change, lambda: perturbed(clean, change, int(value)))()
    chosen = dataset.entries[entry]
    return {**_thin(dataset.load(chosen), 25), **_looked_at(dataset, chosen)}


def changed_frame(name: str) -> Arrays:
    """A frame of the generated camera under a change."""
    from benchmark.datasets.camera_frames import CameraFrames
    from benchmark.datasets.perturbations.frames import perturbed

    change, _, value = name.partition("=")
    dataset = perturbed(CameraFrames(poses=4), change, int(value))
    return mesh_of(dataset, dataset.entries[17])


def _looked_at(dataset: Any, entry: Entry) -> Arrays:
    """Camera of a shape and what it does to a depth image."""
    camera, sensor = dataset.camera(entry), dataset.sensor(entry) if hasattr(dataset, "sensor") else None
    image = np.linspace(0, 1, 60, dtype=np.float32).reshape(6, 10)
    return {
        "camera": np.array([*camera.direction, *camera.up]),
        **({"image": sensor.perturbed(image)} if sensor else {}),
    }


def mesh_file(name: str) -> Arrays:
    from benchmark.geometry.io import read_mesh

    return _thin(read_mesh(inputs.INPUTS / "files" / name), 1)


def folder_files() -> Arrays:
    from benchmark.datasets.folder import folder_dataset

    return entries_of(folder_dataset(inputs.INPUTS / "files"))


def depth_file(name: str) -> Arrays:
    from benchmark.depth.reading import read_depth

    return {"depth": read_depth(inputs.INPUTS / "frames" / name)}


def mask_file(name: str) -> Arrays:
    from benchmark.depth.mask import read_mask

    return {"mask": read_mask(inputs.INPUTS / "frames" / name)}


def intrinsics_file(name: str) -> Arrays:
    from benchmark.depth.intrinsics import read_intrinsics

    found = read_intrinsics(inputs.INPUTS / "frames" / name)
    numbers = [found.fx, found.fy, found.cx, found.cy, *(found.size or ()), *found.distortion]
    return {"numbers": np.array(numbers, dtype=float), "rays": found.rays(53, 42)[::6, ::6]}


# Measures ------------------------------------------------------------------------------------------------------------


def measured(matrices: Sequence[str], answered: bool) -> Arrays:
    stored = inputs.arrays("distances")
    places = stored["answered"].tolist() if answered else None
    given = [stored[name][np.ix_(places, places)] if places else stored[name] for name in matrices]
    return _flat(measures.scores(given, stored["labels"].tolist(), places))


def split(size: int) -> Arrays:
    stored = inputs.arrays("distances")
    return _flat(measures.over_splits([stored["split"]], stored["subjects"].tolist(), size))


def _flat(found: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Numbers of nested dictionaries by their path; the measures of a query that has none are NaN."""
    flat: dict[str, Any] = {}
    for key, value in found.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            numbers = [np.nan if number is None else number for number in value] if isinstance(value, list) else value
            flat[f"{prefix}{key}"] = np.asarray(numbers)
    return flat


# From meshes to a score ----------------------------------------------------------------------------------------------


def scored(method_name: str, scorer_name: str) -> Arrays:
    """Two shapes of two classes each: prepared, brought into their forms, compared and scored."""
    method: Any = variant(method_name, methods()).create()
    scorer = scorer_of(scorer_name, scorers()).create()
    names = ("dog-1", "dog-2", "horse-1", "horse-2")
    signatures = []
    for name in names:
        prepared = complete.complete(inputs.mesh("raw", name))
        surface = Mesh(prepared["vertices"], prepared["faces"])
        made = form.canonicalise(method, Shape(identifier=name, mesh=surface))
        signatures.append(features.extract(scorer, form.form_mesh(made, surface)))
    matrices = [distances.form_distances(scorer, signatures, n) for n in range(scorer.info.draws)]
    return {"distances": np.array(matrices), **_flat(measures.scores(matrices, [n[:-2] for n in names]))}

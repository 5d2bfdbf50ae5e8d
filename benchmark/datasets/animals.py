"""Generated animals and people: the stand-in for TOSCA [Bronstein et al. 2008].

The classes have the sizes of those of TOSCA. The 41 posed animals are data: ``animals.npz`` holds,
for each species, the names of its poses, vertices in micrometres, shape (poses, n, 3), and the
triangles that all its poses share. Commit 4868b8b9 has the generator: articulated skeletons in
smooth implicit bodies, relaxed so that edges nearly keep their lengths. The people are generated.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.bodies import POSES, SUBJECTS, body_mesh, describe_body
from benchmark.files import file_digest
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh

_FILE = Path(__file__).parent / "animals.npz"

#: Micrometres, the unit of the file, per centimetre.
_UNITS = 1e4

#: Centimetres per metre.
_CENTIMETRES = 100.0

#: Decimals of the coordinates of people, in centimetres.
_DECIMALS = 4

BODIES = SUBJECTS["animals"]
"""A slim young man, a heavy strong man, and a woman."""

#: The twelve poses of the woman, and of which the slim man has the first seven.
_SOME = (
    "standing",
    "walking",
    "t-pose",
    "sitting",
    "kicking",
    "dancing",
    "boxing",
    "bending",
    "kneeling",
    "throwing",
    "waving",
    "crouching",
)

#: Poses of the people by class.
_PEOPLE = {"david": _SOME[:7], "michael": tuple(POSES), "victoria": _SOME}

#: Classes with long axis y, viewed from the side; the gorilla and the people are viewed from the
#: front.
_FROM_THE_SIDE = frozenset({"cat", "centaur", "dog", "horse", "wolf"})

#: Least number of shapes of a class of ``animals-few``.
_FEW = 7

#: Numbers of the poses that ``animals-few`` keeps of a class.
_POSES_OF_FEW = (0, 2, 4)


def animals() -> ShapeSet:
    """Return the data set of 80 animals and people, class by class, the canonical pose first.

    All meshes are closed and connected, of genus 0; the poses of a class have the same triangles.
    Coordinates are in centimetres, z up. A body faces -y, its lowest point is at z = 0, and the
    centre of its horizontal extent at x = y = 0.
    """
    shapes = []
    for name, poses in _classes():
        shapes += [Entry(f"{name}{number}", name, pose) for number, pose in enumerate(poses)]
    return ShapeSet(
        name="animals",
        title="animals and people (stand-in for TOSCA)",
        stand_in_for="tosca",
        shapes=tuple(shapes),
        load=lambda entry: _person(entry) if entry.subject in BODIES else _animal(entry),
        key=_key,
        camera=lambda entry: SIDE if entry.subject in _FROM_THE_SIDE else FRONT,
        half_width=190.0,
        code=lambda _: (__name__, "benchmark.datasets.bodies"),
    )


def animals_few() -> ShapeSet:
    """Return a small part of the animals: three poses of each class with at least seven shapes."""
    kept = set[str]()  # identifiers of the shapes, such as "cat4"
    for name, poses in _classes():
        if len(poses) >= _FEW:
            kept.update(f"{name}{number}" for number in _POSES_OF_FEW)
    whole = animals()
    return replace(
        whole,
        name="animals-few",
        title="animals-few (generated, 6 classes x 3 poses)",
        stand_in_for="",
        shapes=tuple(entry for entry in whole.shapes if entry.identifier in kept),
    )


@functools.cache
def _surfaces() -> Mapping[str, NDArray[np.generic]]:
    """Return the arrays of the file of animals."""
    with np.load(_FILE, allow_pickle=False) as arrays:
        return dict(arrays)


def _classes() -> list[tuple[str, Sequence[str]]]:
    """Return the classes in alphabetical order, each with the names of its poses."""
    poses: dict[str, Sequence[str]] = dict(_PEOPLE)
    for name, array in _surfaces().items():
        if name.endswith("-poses"):
            poses[name.removesuffix("-poses")] = array.tolist()
    return sorted(poses.items())


def _animal(entry: Entry) -> Mesh:
    """Return the mesh of an animal, in centimetres."""
    arrays = _surfaces()
    pose = arrays[f"{entry.subject}-poses"].tolist().index(entry.pose)
    return Mesh(
        arrays[f"{entry.subject}-vertices"][pose] / _UNITS,
        arrays[f"{entry.subject}-faces"].astype(np.int32),
    )


def _person(entry: Entry) -> Mesh:
    """Return the mesh of a person, in centimetres, standing on the ground above the origin."""
    mesh = body_mesh(BODIES[entry.subject], POSES[entry.pose])
    vertices = _CENTIMETRES * np.array(mesh.vertices)
    low = vertices.min(axis=0)
    high = vertices.max(axis=0)
    ground = np.append(0.5 * (low + high)[:2], low[2])
    return mesh.with_vertices(np.round(vertices - ground, _DECIMALS))


def _key(entry: Entry) -> str:
    """Return what the mesh of a shape depends on beside the code."""
    if entry.subject in BODIES:
        return f"{describe_body(BODIES[entry.subject], POSES[entry.pose])} x {_CENTIMETRES:g}"
    return f"{entry.identifier} of {file_digest(_FILE)}"

"""Generated animals and people: the stand-in for TOSCA [Bronstein et al. 2008], with the same class sizes.

The 41 posed animals are data: ``animals.npz`` holds, for each species, the names of its poses,
vertices in micrometres, shape (poses, n, 3), and the triangles that all its poses share. Commit
4868b8b9 has the generator: articulated skeletons in smooth implicit bodies, relaxed so that edges
nearly keep their lengths. The people are generated.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.bodies import POSES, SUBJECTS, body_mesh, describe
from benchmark.files import file_digest
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh

_FILE = Path(__file__).parent / "animals.npz"
_UNITS, _CENTIMETRES, _DECIMALS = 1e4, 100.0, 4
"""Units of the file per centimetre, centimetres per metre, and decimals of coordinates in centimetres."""

BODIES = SUBJECTS["animals"]
"""A slim young man, a heavy strong man, and a woman."""

_SOME = (
    *("standing", "walking", "t-pose", "sitting", "kicking", "dancing"),
    *("boxing", "bending", "kneeling", "throwing", "waving", "crouching"),
)
_PEOPLE = {"david": _SOME[:7], "michael": tuple(POSES), "victoria": _SOME}

#: Classes with long axis y, viewed from the side; the gorilla and the people are viewed from the
#: front.
_FROM_THE_SIDE = frozenset({"cat", "centaur", "dog", "horse", "wolf"})

_FEW, _POSES_OF_FEW = 7, (0, 2, 4)
"""Least number of shapes of a class of ``animals-few``, and the poses that it keeps."""


def animals() -> ShapeSet:
    """Return all 80 animals and people, ordered by class, then by pose; number 0 is in the canonical pose.

    The meshes are closed and connected, of genus 0, with the same triangles for all poses of a
    class. Centimetres, z up, facing -y; the lowest point is at z = 0, and the centre of the
    horizontal extent at x = y = 0.
    """
    return ShapeSet(
        name="animals",
        title="animals and people (stand-in for TOSCA)",
        stand_in_for="tosca",
        shapes=tuple(
            Entry(f"{name}{number}", name, pose)
            for name, poses in _classes()
            for number, pose in enumerate(poses)
        ),
        load=lambda entry: _person(entry) if entry.subject in BODIES else _animal(entry),
        key=_key,
        camera=lambda entry: SIDE if entry.subject in _FROM_THE_SIDE else FRONT,
        half_width=190.0,
        code=lambda _: (__name__, "benchmark.datasets.bodies"),
    )


def animals_few() -> ShapeSet:
    """Return three poses of each class with at least seven shapes."""
    kept = {f"{name}{k}" for name, poses in _classes() if len(poses) >= _FEW for k in _POSES_OF_FEW}
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
    with np.load(_FILE, allow_pickle=False) as arrays:
        return dict(arrays)


def _classes() -> list[tuple[str, list[str]]]:
    species = {
        name.removesuffix("-poses"): array
        for name, array in _surfaces().items()
        if name.endswith("-poses")
    }
    return sorted({**{name: array.tolist() for name, array in species.items()}, **_PEOPLE}.items())


def _animal(entry: Entry) -> Mesh:
    arrays = _surfaces()
    pose = arrays[f"{entry.subject}-poses"].tolist().index(entry.pose)
    return Mesh(
        arrays[f"{entry.subject}-vertices"][pose] / _UNITS,
        arrays[f"{entry.subject}-faces"].astype(np.int32),
    )


def _person(entry: Entry) -> Mesh:
    mesh = body_mesh(BODIES[entry.subject], POSES[entry.pose])
    vertices = _CENTIMETRES * np.array(mesh.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return mesh.with_vertices(
        np.round(vertices - np.append(0.5 * (low + high)[:2], low[2]), _DECIMALS)
    )


def _key(entry: Entry) -> str:
    if entry.subject in BODIES:
        return f"{describe(BODIES[entry.subject], POSES[entry.pose])} x {_CENTIMETRES:g}"
    return f"{entry.identifier} of {file_digest(_FILE)}"

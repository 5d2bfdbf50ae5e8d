"""The stand-in for TOSCA: eighty shapes in nine classes of the same sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.animals.generate import generated_mesh, generated_recipe
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.human_poses import POSES as HUMAN_POSES
from benchmark.datasets.human_subjects import Subject
from benchmark.datasets.humans import human_mesh, recipe
from benchmark.errors import did_you_mean
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh

CENTIMETRES = 100.0
"""Centimetres per metre, as generated humans are in metres."""

BODIES = {
    "david": Subject(gender=0.0, age=0.62, muscle=0.55, weight=0.30, height=0.35, proportions=0.80),
    "michael": Subject(gender=0.0, age=0.72, muscle=0.90, weight=0.72, height=0.42, proportions=0.50),
    "victoria": Subject(gender=1.0, age=0.66, muscle=0.45, weight=0.35, height=0.50, proportions=0.85),
}
"""Bodies of a slim young man, a heavy strong man, and a woman."""

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

PEOPLE = {"david": _SOME[:7], "michael": tuple(HUMAN_POSES), "victoria": _SOME}
"""Poses by person; the first is the canonical pose."""


def person_mesh(name: str, pose: str) -> Mesh:
    """Generate a person in an authored pose, in centimetres.

    Raises
    ------
    DatasetError
        If the packages for generating bodies are missing.
    """
    mesh = human_mesh(BODIES[name], HUMAN_POSES[pose])
    return mesh.with_vertices(CENTIMETRES * np.array(mesh.vertices))


def person_recipe(name: str, pose: str) -> str:
    """Return the body parameters and joint angles that determine a mesh."""
    return f"{recipe(BODIES[name], HUMAN_POSES[pose])} x {CENTIMETRES:g}"


CANONICAL_POSE = "standing"
"""Canonical pose, the first pose of every class."""

FROM_THE_SIDE = frozenset({"cat", "centaur", "dog", "horse", "wolf"})
"""Classes with long axis y, viewed from the side; the gorilla and the people are viewed from the front."""

_FEW = 7
"""Least number of shapes of a class of ``animals-few``."""

_DECIMALS = 4
"""Decimals of coordinates in centimetres: micrometres, far above rounding errors."""

_POSES: dict[str, tuple[str, ...]] = dict(
    sorted({**{name: tuple(poses) for name, poses in POSES.items()}, **PEOPLE}.items())
)

CLASSES = {name: len(poses) for name, poses in _POSES.items()}
"""Number of shapes in each class, as in TOSCA (Bronstein, Bronstein and Kimmel, 2008)."""

ENTRIES = {
    f"{name}{number}": Entry(f"{name}{number}", name, pose)
    for name, poses in _POSES.items()
    for number, pose in enumerate(poses)
}
"""All shapes by identifier: ``cat0`` to ``cat10``, ``centaur0`` ..., number 0 in the canonical pose."""


def animals_mesh(identifier: str) -> Mesh:
    """Generate a shape of the set.

    Parameters
    ----------
    identifier
        Class and number, e.g. ``"cat0"``.

    Returns
    -------
    Mesh
        Closed and connected, genus 0, with the same triangles for all poses of a class. Centimetres, z up, facing -y;
        the lowest point is at z = 0, and the centre of the horizontal extent at x = y = 0.

    Raises
    ------
    ConfigurationError
        If the shape is unknown.
    DatasetError
        If the packages for generating human bodies are missing.
    """
    if identifier not in ENTRIES:
        raise did_you_mean("shape of the data set 'animals'", identifier, ENTRIES)
    entry = ENTRIES[identifier]
    make = person_mesh if entry.subject in PEOPLE else generated_mesh
    mesh = make(entry.subject, entry.pose)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    origin = np.append(0.5 * (low + high)[:2], low[2])
    return mesh.with_vertices(np.round(mesh.vertices - origin, _DECIMALS))


def animals() -> ShapeSet:
    """Return all 80 animals and people, ordered by class, then by pose."""
    return ShapeSet(
        name="animals",
        title="animals (stand-in for TOSCA)",
        stand_in_for="tosca",
        shapes=tuple(ENTRIES.values()),
        load=lambda entry: animals_mesh(entry.identifier),
        key=_key,
        camera=lambda entry: SIDE if entry.subject in FROM_THE_SIDE else FRONT,
        half_width=190.0,
        code=(__name__,),
    )


def animals_few() -> ShapeSet:
    """Return three poses of each class with at least seven shapes."""
    kept = {f"{name}{pose}" for name, size in CLASSES.items() if size >= _FEW for pose in (0, 2, 4)}
    return replace(
        animals(),
        name="animals-few",
        title="animals-few (generated, 6 classes x 3 poses)",
        stand_in_for="",
        shapes=tuple(entry for name, entry in ENTRIES.items() if name in kept),
    )


def _key(entry: Entry) -> str:
    """Return the proportions of the body and the pose."""
    make = person_recipe if entry.subject in PEOPLE else generated_recipe
    return make(entry.subject, entry.pose)

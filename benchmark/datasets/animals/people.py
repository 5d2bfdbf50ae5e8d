"""The three people of the set, made by the generator of humans."""

from __future__ import annotations

import numpy as np

from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import Subject
from benchmark.datasets.humans import human_mesh, recipe
from benchmark.geometry.mesh import Mesh

CENTIMETRES = 100.0
"""The generator of humans works in metres."""

BODIES = {
    "david": Subject(gender=0.0, age=0.62, muscle=0.55, weight=0.30, height=0.35, proportions=0.80),
    "michael": Subject(gender=0.0, age=0.72, muscle=0.90, weight=0.72, height=0.42, proportions=0.50),
    "victoria": Subject(gender=1.0, age=0.66, muscle=0.45, weight=0.35, height=0.50, proportions=0.85),
}
"""A slim young man, a heavy strong man, and a woman."""

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

PEOPLE = {"david": _SOME[:7], "michael": tuple(POSES), "victoria": _SOME}
"""Poses of each person by name; the first is the canonical one."""


def person_mesh(name: str, pose: str) -> Mesh:
    """Return one of the people in one of the authored poses, in centimetres.

    Raises
    ------
    DatasetError
        If the packages that make bodies are missing.
    """
    mesh = human_mesh(BODIES[name], POSES[pose])
    return mesh.with_vertices(CENTIMETRES * np.array(mesh.vertices))


def person_recipe(name: str, pose: str) -> str:
    """Name what determines a mesh, without making it."""
    return f"{recipe(BODIES[name], POSES[pose])} x {CENTIMETRES:g}"

"""Lopsided figures for tests of the scorer: ellipsoids stuck together, none equal to its mirror
image.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh


def figure(seed: int = 0, parts: int = 7, subdivisions: int = 2) -> Mesh:
    """A few overlapping ellipsoids of different sizes and directions."""
    rng = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices, faces = [], []
    for part in range(parts):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        stretched = sphere.vertices * rng.uniform(0.15, 0.6, 3) @ axes.T
        vertices.append(stretched + rng.uniform(-0.8, 0.8, 3) * [1.3, 1.0, 0.7])
        faces.append(np.asarray(sphere.faces) + part * len(sphere.vertices))
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def turned(mesh: Mesh, rotation: NDArray[Any]) -> Mesh:
    """The mesh with an orthogonal map applied; a reflection also turns the triangles over."""
    faces = mesh.faces if np.linalg.det(rotation) > 0 else mesh.faces[:, ::-1]
    return Mesh(mesh.vertices @ np.asarray(rotation).T, faces)

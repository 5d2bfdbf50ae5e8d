"""Surfaces with known shape, and the symmetries that every deforming method must respect."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import Mesh, Shape
from tests.toy import rod


def tube(bend: float, rings: int = 40, sides: int = 14) -> Mesh:
    """Closed tube of length 2 along an arc of the given angle, thicker towards one end."""
    bent = rod(0.05, bend, rings, sides)
    return bent.with_vertices(2 * bent.vertices)


def centre_line(vertices: np.ndarray, *, sides: int = 14) -> np.ndarray:
    """Mean position of each ring of a tube."""
    return vertices[:-2].reshape(-1, sides, 3).mean(axis=1)


def straightness(line: np.ndarray) -> float:
    """Distance of the ends over the length of the way between them: 1 for a straight line."""
    return float(
        np.linalg.norm(line[-1] - line[0]) / np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    )


def sheet(rows: int = 30, columns: int = 9, bend: float = 0.0) -> Mesh:
    """Open strip of equilateral triangles, flat or rolled about the y axis by the given angle."""
    u, v = np.meshgrid(
        np.arange(rows) * np.sqrt(3) / 2, np.arange(columns, dtype=float), indexing="ij"
    )
    v = v + 0.5 * (np.arange(rows)[:, None] % 2)
    if bend:
        radius = u.max() / bend
        vertices = np.stack(
            [radius * np.sin(u / radius), v, radius * (1 - np.cos(u / radius))], axis=-1
        )
    else:
        vertices = np.stack([u, v, 0 * u], axis=-1)
    faces = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b = i * columns + j, i * columns + j + 1
            c, d = a + columns, b + columns
            faces += [(a, c, b), (b, c, d)] if i % 2 == 0 else [(a, d, b), (a, c, d)]
    return Mesh(vertices.reshape(-1, 3) / 10, np.array(faces))


def implicit_surface(
    distance, *, extent: float = 1.6, resolution: int = 56, n_vertices: int = 700
) -> Mesh:
    """Zero level of a function of positions (k, 3), decimated to regular triangles."""
    import igl

    from benchmark.geometry.preparation import prepare

    axis = np.linspace(-extent, extent, resolution)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    grid = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    # Moved off the grid: marching cubes makes triangles without area where the level passes through
    # a node.
    vertices, faces, _ = igl.marching_cubes(
        distance(grid + 0.0123), grid, resolution, resolution, resolution, 0.0
    )
    return prepare(Mesh(vertices, faces), n_vertices).mesh


def capsule(points: np.ndarray, start, end, radius: float) -> np.ndarray:
    """Signed distance to a capsule."""
    start, axis = np.asarray(start, float), np.asarray(end, float) - np.asarray(start, float)
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius


def moved_to(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Points after the proper rigid motion that brings them nearest to the reference (independent
    of the kernels).
    """
    rotation, _ = Rotation.align_vectors(
        reference - reference.mean(axis=0), points - points.mean(axis=0)
    )
    return rotation.apply(points - points.mean(axis=0)) + reference.mean(axis=0)


def shape_of(mesh: Mesh, name: str = "test") -> Shape:
    return Shape(identifier=name, mesh=mesh)

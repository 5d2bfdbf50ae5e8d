"""Shapes with known distances, and measures of embeddings."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist, pdist, squareform

from benchmark.api.contracts import Shape
from benchmark.geometry.mesh import Mesh


def sphere(n: int = 400) -> Mesh:
    """Unit sphere through the n points of a Fibonacci spiral."""
    place = np.arange(n) + 0.5
    height = 1 - 2 * place / n
    angle = np.pi * (1 + np.sqrt(5)) * place
    ring = np.sqrt(1 - height**2)
    vertices = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    ball = trimesh.Trimesh(vertices, ConvexHull(vertices).simplices, process=False)
    ball.fix_normals()
    return Mesh(ball.vertices, ball.faces)


def limbed(n: int = 400) -> Shape:
    """Ball with five limbs of different lengths: closed, one piece, no symmetry, geodesics far from
    Euclidean.
    """
    ball = sphere(n)
    directions = np.array(
        [[1, 0.1, 0], [-0.9, 0.3, 0.2], [0.1, -1, 0.2], [0, 0.4, 1], [0.5, 0.5, -0.8]]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    bumps = np.exp(9 * (ball.vertices @ directions.T - 1)) @ np.array([2.4, 1.9, 1.4, 1.0, 0.7])
    mesh = ball.with_vertices(ball.vertices * (0.5 + bumps)[:, None])
    return Shape(identifier="limbed", mesh=mesh.with_vertices(mesh.vertices / np.sqrt(mesh.area)))


class PointShape(Shape):
    """Shape whose "geodesic" distances are given, over the convex hull of some points."""

    def __init__(self, points: np.ndarray, distances: np.ndarray | None = None) -> None:
        super().__init__(identifier="points", mesh=Mesh(points, ConvexHull(points).simplices))
        self.matrix = cdist(points, points) if distances is None else distances
        self.asked: list[int] = []

    def geodesics(self) -> np.ndarray:
        return self.matrix

    def geodesics_from(self, sources: Any) -> np.ndarray:
        self.asked += [int(source) for source in sources]
        return self.matrix[np.asarray(sources)]


class RowsOnly(Shape):
    """A shape that has no all pairs of distances to give."""

    def geodesics(self) -> np.ndarray:
        raise AssertionError("all pairs were asked for")


def points_on_ellipsoid(n: int = 200) -> np.ndarray:
    """Points in general position without any symmetry, all on their convex hull."""
    vertices = sphere(n).vertices
    return np.exp(0.3 * vertices) * [3.0, 2.0, 1.0] + 0.1 * np.sin(3 * vertices[:, ::-1])


def spread(points: np.ndarray) -> np.ndarray:
    """Distances of all pairs, shape (n, n)."""
    return squareform(pdist(points))


def brute_force_stress(points: np.ndarray, distances: np.ndarray) -> float:
    """Normalised stress by its definition."""
    return float(((spread(points) - distances) ** 2).sum() / (distances**2).sum())

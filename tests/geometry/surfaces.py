"""Surfaces whose geometry is known, for the tests of geometry."""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from scipy.spatial.distance import cdist

from benchmark.geometry.mesh import Mesh


def sphere(subdivisions: int) -> Mesh:
    """Unit sphere with 10 * 4**subdivisions + 2 vertices, closed."""
    ball = trimesh.creation.icosphere(subdivisions)
    return Mesh(ball.vertices, ball.faces)


def flat_grid(side: int, spacing: float = 1.0) -> Mesh:
    """Square of side x side vertices in the plane z = 0, all diagonals in one direction, open."""
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    at = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((b, d, c), axis=1)))
    return Mesh(spacing * np.stack((x.ravel(), y.ravel(), np.zeros(side * side)), axis=1), faces)


def limbed_body(subdivisions: int = 4) -> Mesh:
    """A closed body with five limbs of different length, as a displaced sphere."""
    ball = sphere(subdivisions)
    limbs = np.array([[1, 0, 0], [-1, 0.3, 0], [0.1, 1, 0.2], [0, -0.6, 0.8], [0.2, -0.5, -0.9]])
    limbs /= np.linalg.norm(limbs, axis=1, keepdims=True)
    closeness = ball.vertices @ limbs.T - 1.0
    radius = 0.4 + (np.array([2.0, 1.6, 1.2, 1.4, 1.8]) * np.exp(18.0 * closeness)).sum(axis=1)
    return ball.with_vertices(ball.vertices * radius[:, None])


def joined(*meshes: Mesh) -> Mesh:
    """The meshes side by side in one, without any edge between them."""
    offsets = np.cumsum([0] + [mesh.n_vertices for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.faces + offset for mesh, offset in zip(meshes, offsets[:-1], strict=True)]
        ),
    )


def relabelled(mesh: Mesh, seed: int = 0) -> tuple[Mesh, np.ndarray]:
    """The same surface with vertices in another order, and the new index of each old vertex."""
    new = np.random.default_rng(seed).permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[new] = mesh.vertices
    return Mesh(vertices, new[mesh.faces]), new


def exact_distances(mesh: Mesh, sources: np.ndarray) -> np.ndarray:
    """Distances from some vertices of a manifold to all, by libigl, which gives 0 for those that it
    does not reach.
    """
    faces, everywhere = mesh.faces.astype(np.int64), np.arange(mesh.n_vertices)
    found = np.stack(
        [igl.exact_geodesic(mesh.vertices, faces, VS=at, VT=everywhere) for at in sources[:, None]]
    )
    assert (found >= cdist(mesh.vertices[sources], mesh.vertices) * (1 - 1e-6)).all()
    return found


def capped_cylinder(sides: int) -> Mesh:
    """Closed cylinder of radius 1 and height 2: both caps are fans of ``sides`` triangles around
    their centre.
    """
    made = trimesh.creation.cylinder(radius=1, height=2, sections=sides)
    return Mesh(made.vertices, made.faces)


def soup(mesh: Mesh, noise: float = 0.0, seed: int = 0) -> Mesh:
    """Each triangle by itself, with normal noise on its corners, in units of the extent."""
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    jitter = (
        noise
        * np.ptp(mesh.vertices, axis=0).max()
        * np.random.default_rng(seed).standard_normal(corners.shape)
    )
    return Mesh(corners + jitter, np.arange(len(corners)).reshape(-1, 3))


def flipped(mesh: Mesh, share: float, seed: int = 0) -> Mesh:
    """Some of the triangles the other way round."""
    turned = np.random.default_rng(seed).random(mesh.n_faces) < share
    return Mesh(mesh.vertices, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))

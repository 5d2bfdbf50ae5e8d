"""Views of a form: cameras, depth images, and permutations by the 24 rotations of the cube."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh, halved
from benchmark.geometry.rasterise import draw_triangles

#: Depth of pixels that show no surface.
BACKGROUND = 1.0


@dataclass(frozen=True, eq=False)
class ViewSphere:
    """View directions of a form, with the symmetry of the cube.

    Parameters
    ----------
    directions
        Shape (V, 3), float64: unit vectors to the eye.
    """

    directions: NDArray[np.float64]

    def permutation_of(self, rotation: NDArray[np.float64]) -> NDArray[np.int32]:
        """Return the permutation of the views by an orthogonal map of the cube.

        Parameters
        ----------
        rotation
            Signed permutation matrix, shape (3, 3).

        Returns
        -------
        numpy.ndarray
            Shape (V,): entry i is the view whose direction is the image of direction i. Exact,
            because the set of directions has the symmetry of the cube.
        """
        return np.asarray(
            (self.directions @ rotation.T @ self.directions.T).argmax(axis=1), dtype=np.int32
        )

    @cached_property
    def permutations(self) -> NDArray[np.int32]:
        """Permutation of each of the 24 rotations of the cube, shape (24, V)."""
        return np.array([self.permutation_of(rotation) for rotation in CUBE_ROTATIONS])

    @cached_property
    def cameras(self) -> NDArray[np.float64]:
        """Rotations, shape (V, 3, 3): right and up in the image, and the direction to the eye."""
        up = np.tile([0.0, 1.0, 0.0], (len(self.directions), 1))
        up[np.abs(self.directions[:, 1]) > 1 - 1e-9] = [0.0, 0.0, 1.0]
        right = np.cross(up, self.directions)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        return np.stack([right, np.cross(self.directions, right), self.directions], axis=1)


@cache
def view_sphere(subdivisions: int) -> ViewSphere:
    """Return the views from the vertices of a subdivided octahedron: 6, 18, 66, 258 ....

    Each extends the previous one. The 66 of two subdivisions are 6 corners, 12 and 48 edge
    midpoints.
    """
    axes = np.eye(3)
    corners = np.array([axes[0], -axes[0], axes[1], -axes[1], axes[2], -axes[2]])
    sphere = Mesh(corners, np.array([*product((0, 1), (2, 3), (4, 5))]))
    for _ in range(subdivisions):
        finer = halved(sphere)
        middles = finer.vertices[sphere.n_vertices :]
        outwards = middles / np.linalg.norm(middles, axis=1, keepdims=True)
        sphere = finer.with_vertices(np.concatenate([sphere.vertices, outwards]))
    return ViewSphere(sphere.vertices)


def _symmetries_of_cube() -> NDArray[np.float64]:
    """Return the symmetries of the cube, shape (48, 3, 3): signed permutation matrices."""
    signs = np.array([*product((1, -1), repeat=3)])
    matrices = [np.eye(3)[list(order)] * signs[:, np.newaxis] for order in permutations(range(3))]
    return np.concatenate(matrices)


CUBE_SYMMETRIES = _symmetries_of_cube()
#: Its rotations, shape (24, 3, 3).
CUBE_ROTATIONS = CUBE_SYMMETRIES[np.linalg.det(CUBE_SYMMETRIES) > 0]


def render(mesh: Mesh, size: int, sphere: ViewSphere) -> NDArray[np.float32]:
    """Render depth images of a form from cameras around it.

    Each camera is orthographic and sees [-1, 1] x [-1, 1]. Its eye lies on the unit sphere and
    looks at the origin, with the y axis up (the z axis for the two views along y). Both sides of
    the surface are drawn.

    Parameters
    ----------
    mesh
        The form, inside the unit sphere around the origin.
    size
        Height and width of each image in pixels.
    sphere
        View directions.

    Returns
    -------
    numpy.ndarray
        Shape (number of views, size, size), float32: depth (1 - p.v) / 2 in [0, 1] of the nearest
        point p in direction v, or 1 if there is none.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF: visual similarity-based 3D shape retrieval using Clock Matching
    and Bag-of-Features", Machine Vision and Applications 24, 2013.
    """
    images = np.full((len(sphere.directions), size, size), BACKGROUND, dtype=np.float32)
    opposites = sphere.permutation_of(-np.eye(3))
    for view, opposite in enumerate(opposites):
        if view > opposite:  # it was drawn together with the view from the other side
            continue
        right, up, towards_eye = sphere.cameras[view]
        columns = 0.5 * size * (1.0 + _coordinates(mesh, right))
        rows = 0.5 * size * (1.0 - _coordinates(mesh, up))
        depths = 0.5 * (1.0 - _coordinates(mesh, towards_eye))
        pixels = np.stack([columns, rows, depths], axis=1)
        draw_triangles(pixels, mesh.faces, images[view], images[opposite])
    return images


def _coordinates(mesh: Mesh, axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinate of each vertex along an axis, shape (n,).

    Unlike those of a matrix product, its sums are the same to the last bit on all processors.
    """
    x, y, z = mesh.vertices.T
    return np.asarray(axis[0] * x + axis[1] * y + axis[2] * z)

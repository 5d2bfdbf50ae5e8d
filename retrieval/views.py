"""The 66 views of a form: where the cameras stand, what they see, and how the 24 cube rotations permute them."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.geometry.edges import edges_of
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.rasterise import NOT_BEHIND, draw_triangles

N_VIEWS = 66
BACKGROUND = 1.0


def _directions() -> NDArray[np.float64]:
    """Twice-subdivided octahedron, shape (66, 3): unit vectors in the order 6 corners, 12 and 48 edge midpoints."""
    corners = [np.eye(3)[axis] * sign for axis in range(3) for sign in (1.0, -1.0)]
    points = np.array(corners)
    faces = np.array([[a, b, c] for a, b, c in product((0, 1), (2, 3), (4, 5))])
    for _ in range(2):
        ends = edges_of(faces).ends
        midpoint = {(int(a), int(b)): len(points) + row for row, (a, b) in enumerate(ends)}
        middles = points[ends].sum(axis=1)
        split = []
        for a, b, c in faces.tolist():
            ab, bc, ca = (midpoint[min(u, v), max(u, v)] for u, v in ((a, b), (b, c), (c, a)))
            split += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        faces = np.array(split)
    return points


def _cube_rotations() -> NDArray[np.float64]:
    """The 24 rotations of the cube, shape (24, 3, 3): signed permutation matrices of determinant 1."""
    signed = [
        np.eye(3)[list(order)] * signs for order in permutations(range(3)) for signs in product((1, -1), repeat=3)
    ]
    matrices = np.array(signed)
    return np.asarray(matrices[np.linalg.det(matrices) > 0])


def permutation_of(rotation: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return where an orthogonal map of the cube sends each view.

    Parameters
    ----------
    rotation
        Signed permutation matrix, shape (3, 3).

    Returns
    -------
    numpy.ndarray
        Shape (66,): entry i is the view whose direction is the image of direction i. Exact, because the set of
        directions has the symmetry of the cube.
    """
    return np.asarray((DIRECTIONS @ rotation.T @ DIRECTIONS.T).argmax(axis=1), dtype=np.int32)


def _orbits() -> NDArray[np.int32]:
    """Return the orbit of the cube group that a view belongs to, 0 to 3, shape (66,), of 6, 12, 24 and 24 views."""
    smallest = VIEW_PERMUTATIONS.min(axis=0)
    return np.asarray(np.unique(smallest, return_inverse=True)[1], dtype=np.int32)


def _cameras() -> NDArray[np.float64]:
    """Rotations whose rows are the image's right, the image's up and the direction to the eye, shape (66, 3, 3)."""
    up = np.tile([0.0, 1.0, 0.0], (N_VIEWS, 1))
    up[np.abs(DIRECTIONS[:, 1]) > 1 - 1e-9] = [0.0, 0.0, 1.0]
    right = np.cross(up, DIRECTIONS)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(DIRECTIONS, right), DIRECTIONS], axis=1)


DIRECTIONS = _directions()
CUBE_ROTATIONS = _cube_rotations()
VIEW_PERMUTATIONS = np.array([permutation_of(rotation) for rotation in CUBE_ROTATIONS])
ORBITS = _orbits()
CAMERAS = _cameras()
#: The view from the other side of each view; it has the same upwards direction.
OPPOSITE = np.asarray((DIRECTIONS @ DIRECTIONS.T).argmin(axis=1), dtype=np.int32)


def render(mesh: Mesh, size: int, views: slice = slice(None)) -> NDArray[np.float32]:
    """Depth images of a form inside the unit sphere.

    Each camera is orthographic over [-1, 1] x [-1, 1]; its eye lies on the unit sphere and looks at the origin with
    the y axis upwards (the z axis for the two views along y). Both sides of the surface are drawn.

    Parameters
    ----------
    mesh
        The form, inside the unit sphere around the origin.
    size
        Height and width of each image in pixels.
    views
        Which of the 66 views to draw, in the order of :data:`DIRECTIONS`.

    Returns
    -------
    numpy.ndarray
        Shape (number of views, size, size), float32: depth (1 - p.v) / 2 in [0, 1] of the nearest point p in
        direction v, and 1 where there is none.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF: visual similarity-based 3D shape retrieval using Clock Matching and
    Bag-of-Features", Machine Vision and Applications 24, 2013.
    """
    chosen = np.arange(N_VIEWS)[views].tolist()
    rows = {view: row for row, view in enumerate(chosen)}
    fronts = [view for view in chosen if not OPPOSITE[view] < view or OPPOSITE[view] not in rows]
    # Which image shows the front of each, and which one its back, if that is wanted.
    sides = np.array([(rows[view], rows.get(OPPOSITE[view], -1)) for view in fronts], dtype=np.int64)
    images = np.full((len(chosen), size, size), BACKGROUND, dtype=np.float32)
    _draw_views(mesh.vertices, mesh.faces, CAMERAS[fronts], sides, images, NOT_BEHIND)
    return images


@njit(cache=True, nogil=True)
def _draw_views(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    cameras: NDArray[np.float64],
    sides: NDArray[np.int64],
    images: NDArray[np.float32],
    nothing: NDArray[np.float32],
) -> None:
    half = 0.5 * images.shape[1]
    projected = np.empty_like(vertices)
    for v in range(cameras.shape[0]):
        right, up, eye = cameras[v, 0], cameras[v, 1], cameras[v, 2]
        for i in range(vertices.shape[0]):
            x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
            projected[i, 0] = half * (1.0 + (right[0] * x + right[1] * y + right[2] * z))
            projected[i, 1] = half * (1.0 - (up[0] * x + up[1] * y + up[2] * z))
            projected[i, 2] = 0.5 * (1.0 - (eye[0] * x + eye[1] * y + eye[2] * z))
        behind = images[sides[v, 1]] if sides[v, 1] >= 0 else nothing
        draw_triangles(projected, faces, images[sides[v, 0]], behind)

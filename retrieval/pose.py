"""Pose normalisation of a form: unit sphere, then the better of two rotations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh
from retrieval.views import BACKGROUND, render, view_sphere

Matrix = NDArray[np.float64]
Rotations = NDArray[np.float64]

#: Number of values per axis of the search grid of Rodrigues vectors (axis times tan of half the
#: angle); the cube [-tan(pi/8), tan(pi/8)]^3 contains every rotation up to the 24 rotations of the
#: cube.
GRID = 9

#: Number of best grid rotations from which the pattern search starts.
STARTS = 8

#: First step of the pattern search, in radians.
FIRST_STEP = 0.1
#: Step at which it ends, in radians.
LAST_STEP = 1e-6

#: Rotations whose areas are summed together: all turns of all starts about one axis.
LANES = 16

#: Coordinates in the unit sphere are rounded to multiples of this. The last digits of a form are
#: noise that differs between processors, and the bytes of descriptors, and with them the draw of
#: the words, depend on every bit. The grid is far coarser than that noise (about 1e-12), so that
#: nearly every form is then the same to the last bit, and far finer than the scorer resolves: a
#: pixel is 512 steps wide.
RESOLUTION = 2.0**-16
#: Two orientations whose projected areas differ by less than this fraction are equally rectilinear,
#: such as two that a mirror symmetry of the form exchanges.
EQUALLY_RECTILINEAR = 1e-6
#: Two silhouettes whose numbers of pixels differ by less than this fraction are equally large.
#: Moving a silhouette by part of a pixel changes its number of pixels by more.
EQUALLY_LARGE = 1e-3


def to_unit_sphere(mesh: Mesh) -> Mesh:
    """Move the mean of the vertices to the origin and scale the farthest vertex to distance 1.

    Only vertices of triangles count. The public re-implementation of CM-BOF also uses the mean of
    the vertices instead of the area centroid; on the evenly decimated forms of this suite the two
    nearly coincide.

    Raises
    ------
    InvalidMesh
        If there are no triangles or all vertices coincide.
    """
    if mesh.n_faces == 0:
        problem = "the form has no triangles"
        raise InvalidMesh(problem, "return the triangles of the input with the new positions")
    used = np.unique(mesh.faces)
    centred = mesh.vertices - mesh.vertices[used].mean(axis=0)
    radius = np.linalg.norm(centred[used], axis=1).max()
    if radius <= 1e-12 * np.abs(mesh.vertices[used]).max():
        raise InvalidMesh("the form has zero extent", "check the method: all vertices coincide")
    return mesh.with_vertices(centred / radius)


def pca_rotation(mesh: Mesh) -> Matrix:
    """Return the proper rotation onto the principal axes of the vertices, largest variance first.

    The first two axes point to the side of positive third moment.
    """
    points = mesh.vertices[np.unique(mesh.faces)]
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1].copy()
    axes[:2][((centred @ axes[:2].T) ** 3).sum(axis=0) < 0] *= -1.0
    axes[2] = np.cross(axes[0], axes[1])
    return axes


def rectilinearity_rotation(mesh: Mesh) -> Matrix:
    """Return the rotation of least rectilinear area.

    That is the summed area of the projections of all triangles on the three coordinate planes.

    The search covers a grid of all rotations up to symmetries of the cube, followed by a pattern
    search from the best grid points [Hooke & Jeeves 1961]. It is deterministic, unlike the random
    restarts of the original.

    References
    ----------
    Lian, Rosin, Sun, "Rectilinearity of 3D meshes", IJCV 89, 2010.
    """
    area_vectors = 0.5 * mesh.face_normals
    ticks = np.linspace(-1.0, 1.0, GRID) * (np.sqrt(2.0) - 1.0)
    vectors = product(ticks, repeat=3)
    grid = np.array([_turned(np.eye(3), np.array(vector)) for vector in vectors])
    areas = _projected_areas(area_vectors, grid)
    best = np.sort(np.argsort(areas, kind="stable")[:STARTS])
    rotations, areas = _refined(area_vectors, grid[best], areas[best])
    equal = np.flatnonzero(areas <= areas.min() * (1.0 + EQUALLY_RECTILINEAR))
    return np.asarray(rotations[equal[0]])


@njit(cache=True, nogil=True)
def _turned(matrix: Matrix, vector: NDArray[np.float64]) -> Matrix:
    """Return the product of a rotation and a matrix.

    Parameters
    ----------
    matrix
        Shape (3, 3).
    vector
        Rodrigues vector of the rotation, shape (3,): the unit vector along its axis times the
        tangent of half its angle.
    """
    # The matrix of the rotation, by the formula of Rodrigues.
    x, y, z = vector
    scale = 2.0 / (1.0 + x * x + y * y + z * z)
    rotation = np.array(
        [
            [1.0 - scale * (y * y + z * z), scale * (x * y - z), scale * (x * z + y)],
            [scale * (x * y + z), 1.0 - scale * (x * x + z * z), scale * (y * z - x)],
            [scale * (x * z - y), scale * (y * z + x), 1.0 - scale * (x * x + y * y)],
        ]
    )
    product = np.zeros((3, 3))
    for row in range(3):
        for column in range(3):
            for k in range(3):
                product[row, column] += rotation[row, k] * matrix[k, column]
    return product


@njit(cache=True, nogil=True)
def _projected_areas(area_vectors: Matrix, rotations: Rotations) -> NDArray[np.float64]:
    """Return the rectilinear area of a surface after each of several rotations.

    It is the sum of the areas of all triangles, projected on each of the three coordinate planes.
    :data:`LANES` rotations are computed at a time, which takes as long as one.

    Parameters
    ----------
    area_vectors
        Normal of each triangle times its area, shape (m, 3).
    rotations
        Shape (k, 3, 3).

    Returns
    -------
    numpy.ndarray
        Shape (k,).
    """
    areas = np.zeros(len(rotations))
    m = np.zeros((9, LANES))  # the nine entries of the rotation in each lane
    totals = np.empty(LANES)
    for first in range(0, len(rotations), LANES):
        count = min(LANES, len(rotations) - first)
        for lane in range(count):
            m[:, lane] = rotations[first + lane].ravel()
        # The area of a triangle projected along an axis is the coordinate of its turned area vector
        # on that axis, without its sign.
        totals[:] = 0.0
        for x, y, z in area_vectors:
            for lane in range(LANES):
                total = totals[lane] + abs(m[0, lane] * x + m[1, lane] * y + m[2, lane] * z)
                total += abs(m[3, lane] * x + m[4, lane] * y + m[5, lane] * z)
                totals[lane] = total + abs(m[6, lane] * x + m[7, lane] * y + m[8, lane] * z)
        areas[first : first + count] = totals[:count]
    return areas


@njit(cache=True, nogil=True)
def _refined(
    area_vectors: Matrix, rotations: Rotations, areas: NDArray[np.float64]
) -> tuple[Rotations, Matrix]:
    """Improve rotations to ones of a smaller rectilinear area, by pattern search.

    A rotation is turned by a step about each axis in turn, forwards or backwards, if that makes the
    area smaller. If no turn does, the step is halved, until it reaches :data:`LAST_STEP`.

    Parameters
    ----------
    area_vectors
        Normal of each triangle times its area, shape (m, 3).
    rotations
        Where the searches start, shape (k, 3, 3).
    areas
        Their rectilinear areas, shape (k,).

    Returns
    -------
    rotations : numpy.ndarray
        Where the searches end, shape (k, 3, 3).
    areas : numpy.ndarray
        Rectilinear areas of these rotations, shape (k,).
    """
    rotations = rotations.copy()
    areas = areas.copy()
    steps = np.full(len(rotations), FIRST_STEP)
    candidates = np.empty((2, *rotations.shape))
    while (steps > LAST_STEP).any():
        has_ended = steps <= LAST_STEP
        has_improved = np.zeros(len(rotations), dtype=np.bool_)
        for axis in range(3):
            # Turn each rotation backwards and forwards by its step about the axis.
            for start in range(len(rotations)):
                for side in range(2):
                    turn = np.zeros(3)
                    # For small angles, the tangent of half the angle is about half the angle.
                    turn[axis] = (side - 0.5) * steps[start]
                    candidates[side, start] = _turned(rotations[start], turn)
            flat_areas = _projected_areas(area_vectors, candidates.reshape(-1, 3, 3))
            candidate_areas = flat_areas.reshape(2, -1)
            for start in range(len(rotations)):
                # Take the turn backwards if it makes the area smaller, else that forwards.
                side = 0 if candidate_areas[0, start] < areas[start] else 1
                if not has_ended[start] and candidate_areas[side, start] < areas[start]:
                    rotations[start] = candidates[side, start]
                    areas[start] = candidate_areas[side, start]
                    has_improved[start] = True
        steps = np.where(has_improved | has_ended, steps, 0.5 * steps)
    return rotations, areas


ROTATIONS = {"pca": pca_rotation, "rectilinearity": rectilinearity_rotation}


def normalise(mesh: Mesh, candidates: Sequence[str], image_size: int) -> Mesh:
    """Scale a form to the unit sphere, and rotate it to the pose with the smallest silhouettes.

    The silhouettes are those along the three axes, measured together in pixels.

    Parameters
    ----------
    mesh
        The form.
    candidates
        The poses to choose from, ``"pca"`` and ``"rectilinearity"``; the last one wins if two are
        nearly equal. If empty, the form is not rotated.
    image_size
        Height and width, in pixels, of the images in which silhouettes are measured.

    Raises
    ------
    InvalidMesh
        If the form has no triangles or no extent.
    """
    centred = _rounded(to_unit_sphere(mesh))
    best = centred
    fewest_pixels = np.inf
    for name in candidates:
        rotation = ROTATIONS[name](centred)
        turned = _rounded(centred.with_vertices(centred.vertices @ rotation.T))
        views = render(turned, image_size, view_sphere(0))
        axis_views = views[::2]  # the silhouette from the other side is the same
        n_pixels = int((axis_views != BACKGROUND).sum())
        if n_pixels <= fewest_pixels * (1.0 + EQUALLY_LARGE):
            best = turned
            fewest_pixels = n_pixels
    return best


def _rounded(mesh: Mesh) -> Mesh:
    """Return a form with its coordinates rounded to :data:`RESOLUTION`."""
    # Adding 0.0 makes negative zeros positive.
    return mesh.with_vertices(np.round(mesh.vertices / RESOLUTION) * RESOLUTION + 0.0)

"""Pose normalisation of a form: unit sphere, then the better of two rotations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError, InvalidMesh
from benchmark.geometry.mesh import Mesh
from retrieval.views import BACKGROUND, render, view_sphere

Rotation = NDArray[np.float64]

#: Number of values per axis of the search grid of Rodrigues vectors (axis times tan of half the angle); the cube
#: [-tan(pi/8), tan(pi/8)]^3 contains every rotation up to the 24 rotations of the cube.
GRID = 9
#: Number of best grid rotations to refine, and first and last step of the refinement in radians.
STARTS = 8
FIRST_STEP, LAST_STEP = 0.1, 1e-6

#: Coordinates in the unit sphere are rounded to multiples of this. The last digits of a form are noise that differs
#: between processors, and the bytes of descriptors, and with them the draw of the words, depend on every bit. The grid
#: is far coarser than that noise (about 1e-12), so that nearly every form is then the same to the last bit, and far
#: finer than the scorer resolves: a pixel is 512 steps wide.
RESOLUTION = 2.0**-16
#: A third moment below this share of its largest possible value is that of an axis of symmetry and uninformative.
NEGLIGIBLE = 1e-6
#: Two orientations whose projected areas differ by less than this fraction are equally rectilinear, such as two that a
#: mirror symmetry of the form exchanges.
EQUALLY_RECTILINEAR = 1e-6
#: Two silhouettes whose numbers of pixels differ by less than this fraction are equally large. Moving a silhouette by
#: part of a pixel changes its number of pixels by more.
EQUALLY_LARGE = 1e-3


def to_unit_sphere(mesh: Mesh) -> Mesh:
    """Move the mean of the vertices to the origin and scale the farthest vertex to distance 1.

    Only vertices of triangles count. The public re-implementation of CM-BOF also uses the mean of the vertices instead
    of the area centroid; on the evenly decimated forms of this suite the two nearly coincide.

    Raises
    ------
    InvalidMesh
        If there are no triangles or all vertices coincide.
    """
    if mesh.n_faces == 0:
        raise InvalidMesh("the form has no triangles", "return the triangles of the input with the new positions")
    used = np.unique(mesh.faces)
    centred = mesh.vertices - mesh.vertices[used].mean(axis=0)
    radius = np.linalg.norm(centred[used], axis=1).max()
    if radius <= 1e-12 * np.abs(mesh.vertices[used]).max():
        raise InvalidMesh("the form has zero extent", "check the method: all vertices coincide")
    return mesh.with_vertices(centred / radius)


def rounded(mesh: Mesh) -> Mesh:
    """Round the vertices of a form in the unit sphere to multiples of :data:`RESOLUTION`."""
    # Adding 0.0 makes negative zeros positive.
    return mesh.with_vertices(np.round(mesh.vertices / RESOLUTION) * RESOLUTION + 0.0)


def pca_rotation(mesh: Mesh) -> Rotation:
    """Return the rotation onto the principal axes of the vertices, largest variance first, determinant +1.

    The first two axes point to the side of positive third moment, or of the vertex farthest along them if that moment
    is negligible. Clock matching ignores signs, but a rotated view has other pixels, and the signs of an eigensolver
    depend on the processor.
    """
    points = mesh.vertices[np.unique(mesh.faces)]
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1].copy()
    along = centred @ axes[:2].T
    moments = (along**3).sum(axis=0)
    extremes = along.max(axis=0) + along.min(axis=0)
    negligible = np.abs(moments) <= NEGLIGIBLE * (np.abs(along) ** 3).sum(axis=0)
    axes[:2][np.where(negligible, extremes, moments) < 0] *= -1.0
    axes[2] = np.cross(axes[0], axes[1])
    return axes


def rectilinearity_rotation(mesh: Mesh) -> Rotation:
    """Return the rotation that minimises the summed area of the triangles' projections on the three coordinate planes.

    The search covers a grid of all rotations up to symmetries of the cube, followed by a pattern search from the best
    grid points. It is deterministic, unlike the random restarts of the original. Of equally good results, the one from
    the lowest grid point wins. No step uses BLAS or rounds differently between processors, so the same coordinates
    always give the same rotation.

    References
    ----------
    Lian, Rosin, Sun, "Rectilinearity of 3D meshes", IJCV 89, 2010.
    """
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area_vectors = np.ascontiguousarray((0.5 * np.cross(b - a, c - a)).T)
    ticks = np.linspace(-1.0, 1.0, GRID) * (np.sqrt(2.0) - 1.0)
    grid = np.array([_from_rodrigues(x, y, z) for x in ticks for y in ticks for z in ticks])
    areas = np.array([_projected_area(area_vectors, rotation) for rotation in grid])
    starts = grid[np.sort(np.argsort(areas, kind="stable")[:STARTS])]
    refined = [_refine(area_vectors, start, FIRST_STEP, LAST_STEP) for start in starts]
    bound = min(area for _, area in refined) * (1.0 + EQUALLY_RECTILINEAR)
    return np.asarray(next(rotation for rotation, area in refined if area <= bound))


def normalise(mesh: Mesh, candidates: Sequence[str], image_size: int) -> Mesh:
    """Bring a form into the unit sphere and into the candidate pose with the smallest silhouettes.

    The coordinates are multiples of :data:`RESOLUTION`, which removes noise in the last digits of a form.

    Parameters
    ----------
    mesh
        The form.
    candidates
        Names from ``"pca"`` and ``"rectilinearity"``; empty keeps the orientation. Of two, the one with fewer
        foreground pixels, summed over the three axis views, wins; a tie (:data:`EQUALLY_LARGE`) goes to the last.
    image_size
        Height and width, in pixels, of the images for this count.

    Raises
    ------
    ConfigurationError
        If a candidate is unknown.
    InvalidMesh
        If the form has no triangles or no extent.
    """
    centred = rounded(to_unit_sphere(mesh))
    best, fewest = centred, np.inf
    for name in candidates:
        if name not in ROTATIONS:
            raise ConfigurationError(f"unknown pose candidate '{name}'", f"choose from {', '.join(ROTATIONS)}")
        turned = rounded(centred.with_vertices(centred.vertices @ ROTATIONS[name](centred).T))
        if len(candidates) == 1:
            return turned
        pixels = int((render(turned, image_size, view_sphere(0), slice(0, 6, 2)) != BACKGROUND).sum())
        if pixels <= fewest * (1.0 + EQUALLY_LARGE):
            best, fewest = turned, pixels
    return best


ROTATIONS = {"pca": pca_rotation, "rectilinearity": rectilinearity_rotation}


@njit(cache=True, nogil=True)
def _from_rodrigues(x: float, y: float, z: float) -> Rotation:
    """Return the rotation matrix of the unit quaternion along (1, x, y, z)."""
    scale = 2.0 / (1.0 + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - scale * (y * y + z * z), scale * (x * y - z), scale * (x * z + y)],
            [scale * (x * y + z), 1.0 - scale * (x * x + z * z), scale * (y * z - x)],
            [scale * (x * z - y), scale * (y * z + x), 1.0 - scale * (x * x + y * y)],
        ]
    )


@njit(cache=True, nogil=True)
def _projected_area(area_vectors: NDArray[np.float64], rotation: Rotation) -> float:
    # If the compiler chooses the order of a sum, its last digits depend on the processor. Adding the second half to the
    # first until one number is left is a fixed order that still vectorises.
    x, y, z = area_vectors[0], area_vectors[1], area_vectors[2]
    count = area_vectors.shape[1]
    sums = np.empty(count)
    p, q, r = rotation[0], rotation[1], rotation[2]
    for f in range(count):
        onto_p = abs(p[0] * x[f] + p[1] * y[f] + p[2] * z[f])
        onto_q = abs(q[0] * x[f] + q[1] * y[f] + q[2] * z[f])
        onto_r = abs(r[0] * x[f] + r[1] * y[f] + r[2] * z[f])
        sums[f] = onto_p + onto_q + onto_r
    while count > 1:
        half = (count + 1) // 2
        lower, upper = sums[:half], sums[half:count]
        for f in range(count - half):
            lower[f] += upper[f]
        count = half
    return float(sums[0])


@njit(cache=True, nogil=True)
def _refine(
    area_vectors: NDArray[np.float64], rotation: Rotation, first_step: float, last_step: float
) -> tuple[Rotation, float]:
    """Rotate by a step about each axis while that helps, then halve the step [Hooke & Jeeves 1961]."""
    area = _projected_area(area_vectors, rotation)
    step = first_step
    while step > last_step:
        improved = False
        for axis in range(3):
            for sign in (-1.0, 1.0):
                turn = np.zeros(3)
                # Half the angle approximates its tangent well enough.
                turn[axis] = sign * 0.5 * step
                candidate = _product(_from_rodrigues(turn[0], turn[1], turn[2]), rotation)
                candidate_area = _projected_area(area_vectors, candidate)
                if candidate_area < area:
                    rotation, area, improved = candidate, candidate_area, True
                    break
        if not improved:
            step *= 0.5
    return rotation, area


@njit(cache=True, nogil=True)
def _product(first: Rotation, second: Rotation) -> Rotation:
    result = np.empty((3, 3))
    for row in range(3):
        for column in range(3):
            result[row, column] = (
                first[row, 0] * second[0, column]
                + first[row, 1] * second[1, column]
                + first[row, 2] * second[2, column]
            )
    return result

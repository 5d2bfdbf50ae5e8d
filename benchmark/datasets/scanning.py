"""Simulation of a body scanner: asymmetry, fused contacts, an own tessellation, and noise."""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from benchmark.datasets.bodies import CAVITIES, named_random, reference_mesh, vertices_of
from benchmark.geometry.cleaning import largest_component
from benchmark.geometry.mesh import FloatArray, Mesh, Points, sides_of, vertex_normals
from benchmark.geometry.preparation import isotropic_remesh

N_SCAN_VERTICES = 15_000
"""Approximate number of vertices of a scan."""

#: Number of the waves that make a body asymmetric.
_WAVES = 8

#: Shortest and longest wavelength of them, in metres.
_WAVELENGTHS = (0.3, 0.8)

#: Root mean square of their height, in metres.
_ASYMMETRY = 0.003

#: Bones of the parts whose narrow gaps are closed, with their side.
_FUSED = (
    (("wrist", "metacarpal", "finger"), ".L"),
    (("wrist", "metacarpal", "finger"), ".R"),
    (("foot", "toe"), ".L"),
    (("foot", "toe"), ".R"),
)

#: Voxel size in metres.
VOXEL = 0.005

_MARGIN = 6
"""Empty voxels around the body."""

_CLOSING = 0.012
"""Radius in metres of the ball that closes gaps between fingers, up to twice as wide."""

#: Standard deviation of white noise, in metres.
_WHITE = 0.0002

#: Standard deviation of smooth noise, in metres.
_SMOOTH = 0.0003

#: Density at the surface of a solid whose voxels have density 1.
_SURFACE = 0.5

_CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    dtype=np.int64,
)
"""Corners of a cube in the order of libigl's marching cubes."""


def scanned(body: Mesh, subject: str, name: str) -> Mesh:
    """Simulate a scan of a body.

    1. Mouth, nostrils and eye sockets are closed, and the body becomes asymmetric.
    2. It is sampled on a grid in a random position, which fuses its fingers.
    3. Its boundary is extracted by marching cubes [Lorensen and Cline 1987] and re-meshed
       isotropically [Botsch and Kobbelt 2004].
    4. Every vertex moves along its normal by noise of a third of a millimetre.

    Parameters
    ----------
    body
        The body in its pose, with the vertices of the template; it may intersect itself a little.
    subject
        Name of the subject, which seeds its asymmetry.
    name
        Name of the scan, which seeds the position of the grid and the noise.

    Returns
    -------
    Mesh
        A closed, connected surface with about 15 000 vertices, in metres, where the body stands.
    """
    # Mouth, nostrils and eye sockets are cavities behind thin lids, invisible to a scanner.
    closed = membrane(body, _cavities())
    heights = _asymmetry(named_random(subject, "asymmetry"))
    uneven = closed.vertices + heights[:, np.newaxis] * vertex_normals(closed)
    # The grid has a random direction and offset; its unit is a voxel.
    random = named_random(name, "scan")
    turn = _turn_about_z(random.uniform(0, 2 * np.pi))
    in_voxels = uneven @ turn.T / VOXEL
    origin = in_voxels.min(axis=0) - _MARGIN - random.uniform(0, 1, 3)
    solid = _solid(in_voxels - origin, body)
    boundary = _boundary(solid)
    # n vertices of equilateral triangles with side s cover an area of n s^2 sqrt(3) / 2. Re-meshing
    # makes edges slightly longer than asked for, hence the factor.
    side = 0.97 * math.sqrt(boundary.area / N_SCAN_VERTICES * 2 / math.sqrt(3))
    skin = isotropic_remesh(boundary, side, iterations=3, feature_degrees=180)
    in_metres = (skin.vertices + origin) * VOXEL
    return _noisy(skin.with_vertices(in_metres @ turn), random)


def _turn_about_z(angle: float) -> FloatArray:
    """Return the matrix of a rotation about the vertical by an angle in radians."""
    return np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )


def _solid(points: Points, body: Mesh) -> NDArray[np.bool_]:
    """Return which voxels are inside a body whose gaps between fingers are closed.

    Parameters
    ----------
    points
        Vertices in voxels from the corner of the grid.
    body
        The body with these vertices.
    """
    size = np.ceil(points.max(axis=0)).astype(np.int64) + _MARGIN
    crossings = np.zeros(tuple(size), dtype=np.int8)
    _count_crossings(points, body.faces, crossings)
    # Sum of signed crossings below a point: its winding number, which is 2 if two parts overlap.
    solid = np.cumsum(crossings, axis=2, dtype=np.int8) > 0
    for bones, side in _FUSED:
        _close_gaps(solid, points[vertices_of(bones, side)])
    return np.asarray(solid)


@functools.cache
def _cavities() -> NDArray[np.bool_]:
    """Return the mask of the vertices of the head that few of 128 views around the template see.

    Fewer than 12 % of the views see them.
    """
    runs = np.loadtxt(CAVITIES, dtype=np.int64, delimiter=",", skiprows=1)
    sheltered = np.zeros(reference_mesh().n_vertices, dtype=bool)
    for first, last in runs:
        sheltered[first : last + 1] = True
    return sheltered


def _asymmetry(random: np.random.Generator) -> FloatArray:
    """Return the shifts of a body's vertices along their normals, in metres, in all poses."""
    directions = random.normal(size=(_WAVES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frequencies = 2 * np.pi / random.uniform(*_WAVELENGTHS, _WAVES)
    phases = random.uniform(0, 2 * np.pi, _WAVES)
    angles = reference_mesh().vertices @ (directions * frequencies[:, np.newaxis]).T + phases
    return np.asarray(_ASYMMETRY * np.sqrt(2 / _WAVES) * np.cos(angles).sum(axis=1))


def membrane(mesh: Mesh, free: NDArray[np.bool_]) -> Mesh:
    """Return a surface whose free part is a membrane: a free vertex is the mean of its neighbours.

    Parameters
    ----------
    mesh
        A surface; every free component is adjacent to a fixed vertex.
    free
        Mask of the free vertices, shape (n,).
    """
    tails, heads = sides_of(mesh.faces)
    ones = np.ones(len(tails))
    links = csr_array((ones, (tails, heads)), shape=(mesh.n_vertices, mesh.n_vertices))[free]
    degrees = np.asarray(links.sum(axis=1)).ravel()
    system = (diags_array(degrees) - links[:, free]).tocsc()
    vertices = mesh.vertices.copy()
    vertices[free] = spsolve(system, links[:, ~free] @ mesh.vertices[~free])
    return mesh.with_vertices(vertices)


@njit(cache=True, nogil=True)
def _count_crossings(points, faces, crossings):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Count where each line of voxels along z enters and leaves a solid.

    Triangles are drawn row by row. Rows and spans are half-open, and an edge is always evaluated
    from its lower end, so that a line through an edge hits exactly one of its two triangles.

    Parameters
    ----------
    points
        Vertices of a closed surface in units of a voxel, inside the grid, shape (n, 3).
    faces
        Its triangles, shape (m, 3).
    crossings
        Shape of the grid, updated: 1 is added to ``crossings[x, y, z]`` if the line at (x, y)
        enters the solid just below z, -1 if it leaves it there.
    """
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax = points[j, 0] - points[i, 0]
        ay = points[j, 1] - points[i, 1]
        bx = points[k, 0] - points[i, 0]
        by = points[k, 1] - points[i, 1]
        # An upward line enters the solid through a triangle with a downward normal.
        sign = 1 if ax * by - ay * bx < 0 else -1
        # Corners in the order of their rows.
        if points[j, 1] < points[i, 1]:
            i, j = j, i
        if points[k, 1] < points[j, 1]:
            j, k = k, j
            if points[j, 1] < points[i, 1]:
                i, j = j, i
        for row in range(int(np.ceil(points[i, 1])), int(np.ceil(points[k, 1]))):
            x0, z0 = _at_row(points, i, k, row)
            if row < points[j, 1]:
                x1, z1 = _at_row(points, i, j, row)
            else:
                x1, z1 = _at_row(points, j, k, row)
            if x1 < x0:
                x0, x1 = x1, x0
                z0, z1 = z1, z0
            for column in range(int(np.ceil(x0)), int(np.ceil(x1))):
                # Between the ends of the span, hence inside the grid, which has a margin around all
                # points.
                height = z0 + (column - x0) / (x1 - x0) * (z1 - z0)
                crossings[column, row, int(np.ceil(height))] += sign


@njit(cache=True, nogil=True, inline="always")
def _at_row(points, low, high, row):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return x and z where the edge between two points crosses a row of the grid."""
    share = (row - points[low, 1]) / (points[high, 1] - points[low, 1])
    x = points[low, 0] + share * (points[high, 0] - points[low, 0])
    return x, points[low, 2] + share * (points[high, 2] - points[low, 2])


def _close_gaps(solid: NDArray[np.bool_], part: Points) -> None:
    """Apply a morphological closing by a ball in the box around a part, in place."""
    radius = _CLOSING / VOXEL
    low = np.maximum(np.floor(part.min(axis=0)).astype(int) - math.ceil(radius), 0)
    high = np.ceil(part.max(axis=0)).astype(int) + math.ceil(radius) + 1
    box = tuple(slice(start, stop) for start, stop in zip(low, high, strict=True))
    grown = distance_transform_edt(~solid[box]) <= radius
    solid[box] |= distance_transform_edt(grown) > radius


def _boundary(solid: NDArray[np.bool_]) -> Mesh:
    """Return the surface of a solid, by marching cubes on its blurred voxels.

    To save memory, marching cubes gets only the cubes through which the surface runs.

    Parameters
    ----------
    solid
        Voxels inside, shape (x, y, z).

    Returns
    -------
    Mesh
        The largest component, in units of a voxel.
    """
    import igl

    density = gaussian_filter(solid.astype(np.float32), 1.0)
    is_inside = density > _SURFACE
    # The surface runs through a cube of eight neighbouring voxels if some are inside and some
    # outside: if one of them differs from the first.
    width, depth, height = (length - 1 for length in density.shape)
    at_corners = [is_inside[x : x + width, y : y + depth, z : z + height] for x, y, z in _CORNERS]
    is_mixed = functools.reduce(
        np.logical_or, (at_corner != at_corners[0] for at_corner in at_corners)
    )
    # Number the voxels of these cubes, and name the eight corners of each cube by these numbers.
    corners = np.argwhere(is_mixed)[:, np.newaxis, :] + _CORNERS
    voxels = np.ravel_multi_index(tuple(np.moveaxis(corners, 2, 0)), density.shape)
    used_voxels, cubes = np.unique(voxels, return_inverse=True)
    positions = np.stack(np.unravel_index(used_voxels, density.shape), axis=1).astype(np.float64)
    values = density.ravel()[used_voxels].astype(np.float64)
    vertices, faces, _ = igl.marching_cubes(
        values, positions, cubes.reshape(-1, 8).astype(np.int64), _SURFACE
    )
    # libigl orients the triangles towards larger values, i.e. inwards.
    return largest_component(Mesh(vertices, faces[:, ::-1]))


def _noisy(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Return a scan with white and smooth noise along its normals."""
    white, smooth = random.normal(0, 1, (2, mesh.n_vertices))
    smooth = _neighbour_mean(mesh, _neighbour_mean(mesh, smooth))
    amount = _WHITE * white + _SMOOTH * smooth / smooth.std()
    vertices = mesh.vertices + amount[:, np.newaxis] * vertex_normals(mesh)
    return mesh.with_vertices(np.round(vertices, 6))


def _neighbour_mean(mesh: Mesh, values: FloatArray) -> FloatArray:
    """Return the mean of the value of each vertex and those of its neighbours."""
    tails, heads = sides_of(mesh.faces)
    sums = np.bincount(tails, values[heads], mesh.n_vertices) + values
    return np.asarray(sums / (np.bincount(tails, minlength=mesh.n_vertices) + 1))

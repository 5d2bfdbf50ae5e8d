"""Triangle meshes: validated read-only arrays, edges, and a vertex order by positions alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import InvalidMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Numbers in double precision; what each holds is said where it stands.
FloatArray = NDArray[np.float64]
#: Coordinates, shape (n, 3).
Points = FloatArray
IntArray = NDArray[np.int64]
#: Corners of triangles, shape (m, 3).
Faces = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3); stored as float64 that nobody can write to.
    faces
        Vertex indices, shape (m, 3), 0-based; stored as int32 that nobody can write to.

    Raises
    ------
    InvalidMesh
        If the arrays have the wrong shape, a coordinate is not a finite real number, or a vertex
        index is not an integer or out of range. Arrays of an unsuitable type are never cast.
    """

    vertices: Points
    faces: Faces

    def __post_init__(self) -> None:
        """Check both arrays, and replace them by read-only arrays of float64 and int32.

        Raises
        ------
        InvalidMesh
            If an array has another shape or kind, a coordinate is not finite, or a face names a
            vertex that is not there.
        """
        vertices = _triples(self.vertices, "vertices", np.float64)
        faces = _triples(self.faces, "faces", np.int32)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        is_finite = np.isfinite(self.vertices).all(axis=1)
        if not is_finite.all():
            problem = f"{int((~is_finite).sum())} of {self.n_vertices} vertices are NaN or infinite"
            raise InvalidMesh(problem, "repair or re-export the mesh")
        if self.n_faces and self.faces.max() >= self.n_vertices:
            low = self.faces.min()
            high = self.faces.max()
            raise InvalidMesh(
                f"faces name vertices {low} to {high} of {self.n_vertices}, counted from 0",
                "check whether the file counts from 1 or was truncated",
            )

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def face_normals(self) -> Points:
        """Normal of each triangle, twice as long as its area, shape (m, 3); read-only."""
        a = self.vertices[self.faces[:, 0]]
        b = self.vertices[self.faces[:, 1]]
        c = self.vertices[self.faces[:, 2]]
        return read_only(np.cross(b - a, c - a))

    @cached_property
    def face_areas(self) -> Points:
        """Area of each triangle, shape (m,), in squared units of the coordinates; read-only."""
        return read_only(np.asarray(0.5 * np.linalg.norm(self.face_normals, axis=1)))

    @cached_property
    def vertex_areas(self) -> Points:
        """A third of the area of the triangles around each vertex, shape (n,); read-only.

        In squared units of the coordinates.
        """
        shares = np.repeat(self.face_areas / 3, 3)
        areas = np.bincount(self.faces.ravel(), shares, self.n_vertices)
        return read_only(np.asarray(areas, dtype=np.float64))

    @property
    def area(self) -> float:
        """Surface area, in squared units of the coordinates."""
        return float(self.face_areas.sum())

    @cached_property
    def edges(self) -> Edges:
        """Edges of the triangles, computed once."""
        return edges_of(self.faces)

    @cached_property
    def edge_lengths(self) -> Points:
        """Length of each edge, shape (e,), in units of the coordinates; read-only."""
        first, second = self.vertices[self.edges.ends.T]
        return read_only(np.asarray(np.linalg.norm(first - second, axis=1)))

    def edge_graph(self) -> csr_array:
        """Return the lengths of the edges as a symmetric matrix, shape (n, n)."""
        from scipy.sparse import csr_array  # lazy

        tails, heads = np.concatenate([self.edges.ends, self.edges.ends[:, ::-1]]).T
        lengths = np.tile(self.edge_lengths, 2)
        return csr_array((lengths, (tails, heads)), shape=(self.n_vertices, self.n_vertices))

    def with_vertices(self, vertices: ArrayLike) -> Mesh:
        """Return a mesh with the same triangles and new vertex positions."""
        return Mesh(vertices, self.faces)  # type: ignore[arg-type]


def vertex_normals(mesh: Mesh) -> Points:
    """Return the unit normals of the vertices, weighted by area, shape (n, 3); 0 without one."""
    normals = np.zeros((mesh.n_vertices, 3))
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], mesh.face_normals)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return the numbers of an array in memory that nobody can write to, not even through its base.

    They lie in ``bytes``: an array that owns its memory, or is a view of one that does, can be made
    writable again by ``setflags``.
    """
    if _is_of_bytes(array):
        return array
    order: Literal["C", "F"] = "F" if array.flags.fnc else "C"
    return np.ndarray(array.shape, array.dtype, array.tobytes(order), order=order)


def _is_of_bytes(array: NDArray[Any]) -> bool:
    """Return whether the numbers of an array lie in ``bytes``."""
    base = array.base
    while isinstance(base, np.ndarray):
        base = base.base
    return isinstance(base, bytes)


def _triples(array: ArrayLike, what: str, dtype: type[np.number]) -> NDArray[Any]:
    """Return coordinates or vertex indices as a read-only array of shape (count, 3).

    Parameters
    ----------
    array
        What a caller passes as vertices or faces. An empty array of any shape means none.
    what
        What an error calls the array, such as ``"vertices"``.
    dtype
        Type of the result. An integer type means vertex indices, which are not made from floats.

    Raises
    ------
    InvalidMesh
        If it is no array of this shape, its numbers are of another kind, or an index is negative or
        too large for the type.
    """
    try:
        # Masked coordinates become NaN; masked indices cannot, and raise an error.
        values = np.ma.filled(array, np.nan)
    except (TypeError, ValueError, RuntimeError) as error:
        problem = f"{what} are no array: {error}"
        raise InvalidMesh(problem, "pass an array of shape (count, 3)") from error
    if values.size == 0:
        values = np.empty((0, 3), dtype)
    if values.ndim != 2 or values.shape[1] != 3:
        problem = f"{what} have shape {values.shape}, not (count, 3)"
        raise InvalidMesh(problem, "pass triangles in three dimensions")
    are_indices = issubclass(dtype, np.integer)
    expected = "integers" if are_indices else "real numbers"
    accepted_kinds = "iu" if are_indices else "fiu"
    if values.dtype.kind not in accepted_kinds:
        raise InvalidMesh(f"{what} are of type {values.dtype}, not {expected}", f"pass {expected}")
    if are_indices and values.size:
        low = values.min()
        high = values.max()
        if not 0 <= low <= high <= np.iinfo(np.dtype(dtype)).max:
            problem = f"{what} name vertices {low} to {high}"
            raise InvalidMesh(problem, "count the vertices from 0")
    return read_only(np.asarray(values, dtype=dtype, order="C"))


@dataclass(frozen=True, eq=False)
class Edges:
    """The undirected edges of a set of triangles; the arrays are read-only.

    Parameters
    ----------
    ends
        End vertices, smaller index first, shape (e, 2); rows ascend.
    counts
        Number of sides on each edge, shape (e,): 1 at a boundary, 2 inside a manifold.
    of_sides
        Edge of each side, shape (3 m,), in the order of :func:`sides_of`.
    grouped_sides
        All sides, grouped by edge and ascending within an edge, shape (3 m,).
    """

    ends: IntArray
    counts: IntArray
    of_sides: IntArray
    grouped_sides: IntArray

    def __post_init__(self) -> None:
        for name in ("ends", "counts", "of_sides", "grouped_sides"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def first(self) -> IntArray:
        """Index of the first side of each edge in ``grouped_sides``, shape (e,)."""
        return np.asarray(np.cumsum(self.counts) - self.counts)

    @property
    def boundary(self) -> IntArray:
        """Ends of the edges with a single side, shape (b, 2)."""
        return np.asarray(self.ends[self.counts == 1])


def sides_of(faces: NDArray[np.integer]) -> tuple[IntArray, IntArray]:
    """Return the start and end vertices of the sides of triangles.

    Parameters
    ----------
    faces
        Shape (m, 3).

    Returns
    -------
    starts, ends : numpy.ndarray
        Shape (3 m,) each: side 3 f + k runs from corner k to corner k + 1 of face f.
    """
    corners = faces.astype(np.int64)
    return corners.ravel(), np.roll(corners, -1, axis=1).ravel()


def edges_of(faces: NDArray[np.integer]) -> Edges:
    """Return the undirected edges of triangles, and which sides of the triangles lie on each.

    Parameters
    ----------
    faces
        Vertex indices, shape (m, 3). Side 3 f + k runs from corner k of face f to the next corner.
    """
    starts, ends = sides_of(faces)
    # One number for both ends of a side, the smaller vertex first: all sides of an edge have the
    # same number.
    base = int(faces.max(initial=0)) + 1
    keys = np.minimum(starts, ends) * base + np.maximum(starts, ends)
    edge_keys, of_sides, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return Edges(
        ends=np.stack(np.divmod(edge_keys, base), axis=1),
        counts=counts,
        of_sides=of_sides,
        grouped_sides=np.argsort(keys, kind="stable"),
    )


def halved(mesh: Mesh) -> Mesh:
    """Split each triangle into four at the edge midpoints.

    These follow the vertices in the order of the edges.
    """
    edges = mesh.edges
    middles = (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]]) / 2
    a, b, c = mesh.faces.T.astype(np.int64)
    ab, bc, ca = (edges.of_sides.reshape(-1, 3) + mesh.n_vertices).T
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    faces = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
    return Mesh(np.concatenate([mesh.vertices, middles]), faces)


#: Side of the grid cells for sorting vertices, far below the edge length of a prepared mesh.
CELL = 1 / 256
#: Offset of the grid in cells, which keeps coordinates of mirrored and regular shapes off the cell
#: borders.
_OFFSET = (0.137, 0.389, 0.713)
#: Bits of a coordinate on the grid: three of them fit into 64.
_BITS = 21

#: Decimals of coordinates that break ties within a cell.
_DECIMALS = 6


def in_spatial_order(mesh: Mesh) -> Mesh:
    """Sort the vertices of a prepared mesh along a Z-order curve, and triangles by their vertices.

    Ties within a cell are broken by coordinates, and ties in position by the adjacent triangles, so
    that the result does not depend on the numbering in the file. Each triangle begins with its
    smallest vertex and keeps its orientation.

    References
    ----------
    Morton, "A computer oriented geodetic data base and a new technique in file sequencing", 1966.
    """
    ties = np.round(np.hstack([mesh.vertices, _means_around(mesh)]), _DECIMALS)
    order = np.lexsort((*ties.T[::-1], _places_on_curve(mesh.vertices)))
    faces = np.argsort(order).astype(np.int32)[mesh.faces]
    turned = (faces.argmin(axis=1)[:, np.newaxis] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turned, axis=1)
    return Mesh(mesh.vertices[order], faces[np.lexsort(faces.T[::-1])])


def measurements(mesh: Mesh) -> str:
    """Return vertex and triangle counts, and moments of the distances from the centre.

    The moments are of the distances over their root mean square, rounded to six decimals, and
    invariant to rigid motions, reflections, scaling and renumbering.
    """
    distances = np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1)
    relative = distances / (np.sqrt(np.mean(distances**2)) or 1.0)
    moments = [f"{np.mean(relative**power):.6f}" for power in (1, 3, 4, 5)]
    return " ".join([str(mesh.n_vertices), str(mesh.n_faces), *moments])


def _places_on_curve(vertices: Points) -> NDArray[np.uint64]:
    """Return the Morton code of the cell of each vertex, shape (n,).

    It interleaves the bits of the coordinates.
    """
    cells = np.floor(vertices / CELL + _OFFSET)
    cells = np.clip(cells - cells.min(axis=0), 0, 2**_BITS - 1).astype(np.uint64)
    places = np.zeros(len(cells), dtype=np.uint64)
    for bit in range(_BITS):
        for axis in range(3):
            bits = cells[:, axis] >> np.uint64(bit) & np.uint64(1)
            places |= bits << np.uint64(3 * bit + axis)
    return places


def _means_around(mesh: Mesh) -> Points:
    """Return the mean of the corners of the triangles at each vertex, shape (n, 3)."""
    corners = mesh.faces.ravel()
    sums = np.zeros((mesh.n_vertices, 3))
    np.add.at(sums, corners, np.repeat(mesh.vertices[mesh.faces].sum(axis=1), 3, axis=0))
    counts = np.maximum(3 * np.bincount(corners, minlength=mesh.n_vertices), 1)
    return np.asarray(sums / counts[:, np.newaxis])

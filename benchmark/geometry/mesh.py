"""A triangle mesh: two read-only arrays that are known to fit together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import InvalidMesh

Points = NDArray[np.float64]
Faces = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3); stored as a read-only float64 copy.
    faces
        Vertex indices, shape (m, 3), 0-based; stored as a read-only int32 copy.

    Raises
    ------
    InvalidMesh
        If the arrays have the wrong shape, a coordinate is not a finite real number, or a face names by anything but an
        integer, or names a vertex that does not exist. Nothing is cast that would change.
    """

    vertices: Points
    faces: Faces

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _read_only(self.vertices, np.float64, "vertices", "fiu"))
        object.__setattr__(self, "faces", _read_only(self.faces, np.int32, "faces", "iu"))
        if not np.isfinite(self.vertices).all():
            bad = int((~np.isfinite(self.vertices).all(axis=1)).sum())
            raise InvalidMesh(
                f"{bad} of {self.n_vertices} vertices are NaN or infinite", "repair or re-export the mesh"
            )
        if self.n_faces and (self.faces.min() < 0 or self.faces.max() >= self.n_vertices):
            raise InvalidMesh(
                f"a face names vertex {int(self.faces.max())} or {int(self.faces.min())} "
                f"but there are {self.n_vertices} vertices, counted from 0",
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

    @property
    def face_areas(self) -> Points:
        """Area of each triangle, shape (m,), in squared units of the coordinates."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    @property
    def area(self) -> float:
        """Surface area, in squared units of the coordinates."""
        return float(self.face_areas.sum())

    def with_vertices(self, vertices: ArrayLike) -> Mesh:
        """Return the same triangles over other positions of the same vertices."""
        return Mesh(vertices, self.faces)  # type: ignore[arg-type]


def _read_only(array: ArrayLike, dtype: type, what: str, kinds: str) -> NDArray[Any]:
    try:
        given = np.asarray(array)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InvalidMesh(f"{what} are no array: {error}", "pass an array of shape (count, 3)") from error
    if given.size == 0:
        given = np.empty((0, 3), dtype)
    if given.ndim != 2 or given.shape[1] != 3:
        raise InvalidMesh(f"{what} have shape {given.shape}, not (count, 3)", "pass triangles in three dimensions")
    if given.dtype.kind not in kinds:
        wanted = "real numbers" if "f" in kinds else "integers"
        raise InvalidMesh(f"{what} are of type {given.dtype}, not {wanted}", f"pass {wanted}")
    if "f" not in kinds and given.size and not 0 <= given.min() <= given.max() <= np.iinfo(dtype).max:
        raise InvalidMesh(f"{what} name vertices {given.min()} to {given.max()}", "count the vertices from 0")
    copy: NDArray[Any] = np.array(given, dtype=dtype, order="C", copy=True)
    copy.flags.writeable = False
    return copy

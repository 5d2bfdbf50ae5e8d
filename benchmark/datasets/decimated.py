"""Data sets with meshes decimated by another program before preparation: ``tosca[decimation=libigl]``."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.changed import ChangedDataset
from benchmark.errors import DatasetError, did_you_mean
from benchmark.geometry.cleaning import clean, make_manifold
from benchmark.geometry.mesh import Mesh

__all__ = ["DECIMATIONS", "N_VERTICES", "Decimated", "decimated", "decimated_name", "is_installed", "parsed_decimation"]

N_VERTICES = 2000
"""Target number of vertices; preparation does not decimate such meshes further."""

_AGGRESSIVENESS = 3
"""Parameter of fast-simplification; the default, 7, doubles the distance between the surfaces and saves no time."""

_NAME = re.compile(r"(?P<base>.+)\[decimation=(?P<program>[^\[\]]*)\]", re.DOTALL)


def _libigl(mesh: Mesh, n_faces: int) -> Mesh:
    """Decimate by quadric edge collapse in libigl."""
    import igl

    vertices, faces, _, _ = igl.qslim(mesh.vertices, mesh.faces.astype(np.int64), n_faces)
    return Mesh(vertices, faces)


def _fast_simplification(mesh: Mesh, n_faces: int) -> Mesh:
    """Decimate by quadric edge collapse with increasing thresholds instead of a queue."""
    import fast_simplification

    points, faces = mesh.vertices.copy(), mesh.faces.astype(np.int32)  # requires writable arrays
    return Mesh(*fast_simplification.simplify(points, faces, target_count=n_faces, agg=_AGGRESSIVENESS))


DECIMATIONS: dict[str, Callable[[Mesh, int], Mesh]] = {
    "libigl": _libigl,
    "fast-simplification": _fast_simplification,
}
"""Decimation programs by name; each collapses edges of a manifold mesh to about the given number of faces."""

_PACKAGES = {"libigl": "igl", "fast-simplification": "fast_simplification"}


def is_installed(program: str) -> bool:
    """Return whether a program is installed."""
    return importlib.util.find_spec(_PACKAGES[program]) is not None


def decimated_name(base: str, program: str) -> str:
    """Return the name of a data set decimated by a program."""
    return f"{base}[decimation={program}]"


def parsed_decimation(name: str) -> tuple[str, str] | None:
    """Return the data set and the program in a name; None if it is not the name of a decimated set.

    Raises
    ------
    ConfigurationError
        If the program is unknown.
    """
    match = _NAME.fullmatch(name)
    if not match:
        return None
    if match["program"] not in DECIMATIONS:
        raise did_you_mean("decimation", match["program"], DECIMATIONS)
    return match["base"], match["program"]


def decimated(mesh: Mesh, program: str, n_vertices: int = N_VERTICES) -> Mesh:
    """Decimate a mesh to about ``n_vertices``; smaller meshes are returned unchanged.

    Parameters
    ----------
    mesh
        Any triangle mesh.
    program
        A key of :data:`DECIMATIONS`.
    n_vertices
        Target number of vertices.

    Raises
    ------
    InvalidMesh
        If no usable mesh remains.
    """
    manifold = make_manifold(clean(mesh)[0])
    surplus = manifold.n_vertices - n_vertices
    if surplus <= 0:
        return mesh
    # The programs use absolute thresholds, so the scale must not depend on the file unit.
    centre, size = manifold.vertices.mean(axis=0), np.sqrt(manifold.area)
    scaled = manifold.with_vertices((manifold.vertices - centre) / size)
    coarse = DECIMATIONS[program](scaled, manifold.n_faces - 2 * surplus)
    return coarse.with_vertices(centre + size * coarse.vertices)


@dataclass(frozen=True)
class Decimated(ChangedDataset):
    """A data set with decimated shapes, as complete surfaces only, because a camera sees the mesh in the file.

    Parameters
    ----------
    program
        A key of :data:`DECIMATIONS`.
    """

    program: str

    @classmethod
    def of(cls, clean: Dataset, program: str) -> Decimated:
        """Create the data set; raises ``DatasetError`` if the program is not installed."""
        if not is_installed(program):
            raise DatasetError(f"this decimation needs the package '{program}'", f"run `pip install {program}`")
        return cls(clean, program)

    @property
    def name(self) -> str:
        """Name in plans and records."""
        return decimated_name(self.clean.name, self.program)

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"{self.clean.title}, decimated by {self.program}"

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Complete surfaces, if the clean set supports them."""
        return tuple(input_ for input_ in super().inputs if input_ == "mesh")

    def changed(self, mesh: Mesh, entry: Entry) -> Mesh:
        """Decimate a mesh; errors are those of :func:`decimated`."""
        return decimated(mesh, self.program)

    def recipe(self, entry: Entry) -> str:
        """Return the recipe of the clean mesh, the program and the target size."""
        return f"{self._clean_recipe(entry)} {self.program} {N_VERTICES}"

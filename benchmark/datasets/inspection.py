"""Inspection of unprocessed meshes: counts, components, holes and defects."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import CleaningReport, clean
from benchmark.geometry.depth import camera_coordinates
from benchmark.geometry.mesh import Faces, Mesh, edges_of


@dataclass(frozen=True)
class Inspection:
    """Properties of a mesh.

    Parameters
    ----------
    digest
        Digest of vertices and faces, independent of the file format.
    cleaning
        Counts from :func:`benchmark.geometry.cleaning.clean`.
    faces_left
        Number of faces after cleaning.
    holes
        Number of boundary loops; loops that share a vertex count as one.
    extent
        Half the longest side of the bounding box in the camera's frame, in file units.
    """

    digest: str
    cleaning: CleaningReport
    faces_left: int
    holes: int
    extent: float


def inspect(mesh: Mesh, camera: Camera) -> Inspection:
    """Inspect an unprocessed mesh; holes and components are counted after cleaning."""
    cleaned, report = clean(mesh)
    return Inspection(
        digest=hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest(),
        cleaning=report,
        faces_left=cleaned.n_faces,
        holes=count_holes(cleaned.faces) if report.boundary_edges else 0,
        extent=float(np.abs(camera_coordinates(cleaned, camera)).max()) if cleaned.n_faces else 0.0,
    )


def count_holes(faces: Faces) -> int:
    """Return the number of connected components of the boundary edges."""
    vertices, ends = np.unique(edges_of(faces).boundary, return_inverse=True)
    ends = ends.reshape(-1, 2)
    shape = (len(vertices), len(vertices))
    graph = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=shape)
    return int(connected_components(graph.tocsr(), directed=False)[0])


def flaws(inspection: Inspection) -> Iterator[tuple[str, str]]:
    """Yield the defects that prevent a mesh from being a connected closed manifold, each with its effect or a fix."""
    cleaning = inspection.cleaning
    if cleaning.merged:
        what = _many(cleaning.merged, "duplicate vertex", "duplicate vertices")
        yield what, "nothing to do: preparation merges equal positions"
    useless = (
        (cleaning.unreferenced, "vertex without a face", "vertices without a face"),
        (cleaning.degenerate_faces, "degenerate face", ""),
        (cleaning.duplicate_faces, "duplicate face", ""),
    )
    for count, one, several in useless:
        if count:
            yield _many(count, one, several), "nothing to do: preparation drops what carries no surface"
    if cleaning.components > 1:
        yield f"{cleaning.components} components", "join them if the surface should be in one piece"
    if cleaning.boundary_edges:
        holes = _many(inspection.holes, "hole")
        yield (
            f"{_many(cleaning.boundary_edges, 'boundary edge')} around {holes}",
            "close the surface for methods that need it closed",
        )
    if cleaning.non_manifold_edges:
        yield _many(cleaning.non_manifold_edges, "non-manifold edge"), "remove faces until each edge has two"
    if cleaning.non_manifold_vertices:
        what = _many(cleaning.non_manifold_vertices, "non-manifold vertex", "non-manifold vertices")
        yield what, "split each into one vertex per fan of faces"


def _many(count: int, one: str, several: str = "") -> str:
    return f"{count} {one if count == 1 else several or one + 's'}"

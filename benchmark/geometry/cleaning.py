"""Repair of triangle meshes: duplicates, degenerate faces, unreferenced vertices, non-manifold edges and vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh, Points, edges_of, sides_of

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


LARGEST_LOSS = 0.25
"""Maximum fraction of the area that preparation may lose.

A leg is 18 % of the surface of a human body, an arm 9 % (the rule of nines of burn medicine): a shape that has lost
more than a quarter no longer shows the subject. Ordinary data sets lose far less, see ``docs/data.md``.
"""

#: Range of extents for which the areas of the shape and of its small triangles neither overflow nor underflow.
_EXTENTS = (1e-100, 1e100)


def clean(mesh: Mesh) -> tuple[Mesh, dict[str, int]]:
    """Merge duplicate vertices; drop degenerate and duplicate faces and unreferenced vertices.

    Only vertices at *exactly* the same position are merged. This repairs files that store each triangle separately; a
    tolerance would weld surfaces that merely touch (lips, fingers, eyelids) and change the geodesics.

    Returns
    -------
    Mesh
        The cleaned mesh; vertices and faces keep their relative order.
    dict
        Counts: ``vertices_before`` and ``faces_before``; what was removed: ``merged`` (duplicate vertices),
        ``degenerate_faces`` (two corners coincide, or no area), ``duplicate_faces`` and ``unreferenced`` (vertices);
        of the result: ``components``, ``boundary_edges``, ``non_manifold_edges`` (with more than two faces) and
        ``non_manifold_vertices`` (whose faces do not form a single fan).

    Raises
    ------
    InvalidMesh
        If the extent of the mesh is zero, or so small or large that areas underflow or overflow.
    """
    extent_of(mesh)
    distinct, place = merge_duplicates(mesh.vertices)
    proper = mesh.face_areas > 0
    degenerate = mesh.n_faces - int(proper.sum())
    faces = place[mesh.faces[proper]]
    single = np.sort(_distinct(np.sort(faces, axis=1))[0])
    duplicates = len(faces) - len(single)
    faces = faces[single]
    cleaned = compact(distinct, faces)
    counts = edges_of(cleaned.faces).counts
    return cleaned, {
        "vertices_before": mesh.n_vertices,
        "faces_before": mesh.n_faces,
        "merged": mesh.n_vertices - len(distinct),
        "degenerate_faces": degenerate,
        "duplicate_faces": duplicates,
        "unreferenced": len(distinct) - cleaned.n_vertices,
        "components": int(connected_components(cleaned).max(initial=-1)) + 1,
        "boundary_edges": int((counts == 1).sum()),
        "non_manifold_edges": int((counts > 2).sum()),
        "non_manifold_vertices": int((fans_per_vertex(cleaned) > 1).sum()),
    }


def extent_of(mesh: Mesh) -> float:
    """Return the longest side of the bounding box; raises ``InvalidMesh`` if it is zero or areas are out of range."""
    with np.errstate(over="ignore"):
        extent = float(np.ptp(mesh.vertices, axis=0).max()) if mesh.n_vertices else 0.0
    if not _EXTENTS[0] < extent < _EXTENTS[1]:
        raise InvalidMesh(
            f"the bounding box of the mesh has extent {extent:g}",
            "pass a surface of positive size in a unit that fits it",
        )
    return extent


def make_manifold(mesh: Mesh) -> Mesh:
    """Return a mesh with at most two faces per edge and one fan of faces per vertex.

    An edge with more than two faces keeps the two largest: internal walls and slivers are dropped, and the surface
    around them stays connected. A vertex with several fans is split into one vertex per fan, at the same position.
    """
    faces = mesh.faces.astype(np.int64)
    areas = mesh.face_areas
    edges = edges_of(faces)
    if (edges.counts > 2).any():
        # Rank of each side among the sides of its edge, largest face first; ties by face order.
        size = np.repeat(areas, 3)
        order = np.lexsort((np.arange(len(size)), -size, edges.of_sides))
        rank = np.empty(len(size), dtype=np.int64)
        rank[order] = np.arange(len(size)) - edges.first[edges.of_sides[order]]
        keep = ~(rank.reshape(-1, 3) >= 2).any(axis=1)
        faces, areas = faces[keep], areas[keep]
    fan, owner = _fans(faces)
    # Order fans by their vertex, so that a manifold mesh stays unchanged.
    order = np.argsort(owner, kind="stable")
    rank_of_fan = np.empty_like(order)
    rank_of_fan[order] = np.arange(len(order))
    return Mesh(mesh.vertices[owner[order]], rank_of_fan[fan].reshape(-1, 3).astype(np.int32))


def connected_components(mesh: Mesh) -> IntArray:
    """Label each vertex with its edge-connected component, shape (n,), numbered from 0 by first vertex.

    An isolated vertex is a separate component.
    """
    return component_labels(*sides_of(mesh.faces), mesh.n_vertices)


def largest_component(mesh: Mesh) -> Mesh:
    """Return the component with the largest area."""
    areas, of_face = component_areas(mesh)
    return compact(mesh.vertices, mesh.faces[of_face == int(np.argmax(areas))]) if len(areas) else mesh


def component_areas(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """Return the area of each component, shape (c,), and the component of each face, shape (m,)."""
    labels = connected_components(mesh)
    of_face = labels[mesh.faces[:, 0]]
    areas = np.bincount(of_face, mesh.face_areas, int(labels.max(initial=-1)) + 1)
    return areas.astype(np.float64), of_face


def compact(vertices: Points, faces: NDArray[np.integer]) -> Mesh:
    """Return the mesh of the given faces without unreferenced vertices, in the same order."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    place = np.cumsum(used) - 1
    return Mesh(vertices[used], place[faces].astype(np.int32))


def fans_per_vertex(mesh: Mesh) -> IntArray:
    """Return the number of fans of edge-connected faces at each vertex, shape (n,): 1 on a manifold."""
    return np.bincount(_fans(mesh.faces.astype(np.int64))[1], minlength=mesh.n_vertices).astype(np.int64)


def merge_duplicates(vertices: Points) -> tuple[Points, IntArray]:
    """Return the distinct positions in order of first occurrence and the index of each vertex among them."""
    first, group = _distinct(vertices + 0.0)  # -0.0 becomes 0.0
    kept = np.sort(first)
    return vertices[kept], np.searchsorted(kept, first)[group]


def _distinct(rows: NDArray[np.generic]) -> tuple[IntArray, IntArray]:
    """Return the first occurrence of each distinct row, in ascending order of rows, and the number of each row."""
    order = np.lexsort(rows.T[::-1])
    is_new = np.ones(len(rows), dtype=bool)
    is_new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    group = np.empty(len(rows), dtype=np.int64)
    group[order] = np.cumsum(is_new) - 1
    return order[is_new], group


def _fans(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Label each corner with its fan (edge-connected faces around its vertex), shape (3 m,); and the vertex of each."""
    edges = edges_of(faces)
    order = edges.grouped_sides
    # Consecutive sides of an edge share both end points; non-manifold edges chain all their faces.
    follows = np.ones(len(order), dtype=bool)
    follows[edges.first] = False
    sides, previous = order[follows], order[np.flatnonzero(follows) - 1]
    start_corner, end_corner = sides_of(np.arange(3 * len(faces)).reshape(-1, 3))
    vertex = faces.ravel()
    links_from, links_to = [], []
    for corner in (start_corner, end_corner):
        for other in (start_corner, end_corner):
            same = vertex[corner[sides]] == vertex[other[previous]]
            links_from.append(corner[sides][same])
            links_to.append(other[previous][same])
    fan = component_labels(np.concatenate(links_from), np.concatenate(links_to), 3 * len(faces))
    owner = np.zeros(int(fan.max(initial=-1)) + 1, dtype=np.int64)
    owner[fan] = vertex
    return fan, owner


def component_labels(tails: IntArray, heads: IntArray, count: int) -> IntArray:
    """Return the connected component of each of ``count`` nodes of a graph from its edges, in order of first nodes."""
    from scipy.sparse import coo_array, csgraph  # lazy: the import takes a third of a second

    graph = coo_array((np.ones(len(tails), dtype=np.int8), (tails, heads)), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph.tocsr(), directed=False)[1], dtype=np.int64)

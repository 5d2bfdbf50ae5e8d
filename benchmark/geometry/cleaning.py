"""Repair of triangle meshes: duplicates, degenerate faces, unreferenced vertices, non-manifold edges and vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Edges, FloatArray, IntArray, Mesh, Points, edges_of, sides_of
from benchmark.text import counted

LARGEST_LOSS = 0.25
"""Maximum fraction of the area that preparation may lose.

A leg is 18 % of the surface of a human body, an arm 9 % (the rule of nines of burn medicine): a
shape that has lost more than a quarter no longer shows the subject. Ordinary data sets lose far
less, see ``docs/data.md``. """

COPIES = 4e-6
"""Distance below which vertices are copies of one, in units of the root of the area: what rounding moves apart.

In the data sets of the suite, different vertices are at least forty times as far apart.
"""

SEAM = 5
"""Distance between borders that are closed where copies were merged, in units of that of copies."""

#: Height below which a triangle has no area, in the same units: rounding in preparation could turn
#: it over.
_FLAT = 2e-6

#: Distance from the centre beyond which vertices are stray, in units of the median distance, if
#: those within end at a tenth of it.
_STRAY = 100

#: Most copies of a vertex at different positions, and most rounds of splitting.
_MOST_COPIES, _MOST_ROUNDS = 1000, 4096

#: Volume that has no sign, in units of the root of the area cubed.
_NO_VOLUME = 1e-9

#: Range of extents for which the areas of the shape and of its small triangles neither overflow nor
#: underflow.
_EXTENTS = (1e-100, 1e100)

#: Distance between neighbouring numbers of single precision above which they move a shape, in units
#: of its extent.
_COARSE = 1e-3

#: Least number of coordinates that tell single precision from decimals.
_FEWEST_TELLING = 30


def clean(mesh: Mesh) -> tuple[Mesh, dict[str, int]]:
    """Merge copies of vertices; remove triangles without area, duplicate faces and unreferenced vertices.

    Vertices within :data:`COPIES` of each other become one at their mean, and so do chains of such
    vertices. This joins files that store each triangle or part separately, also where rounding
    moved the copies. Where three corners of a triangle lie on a line, the triangles across its
    longest side are split at the third: no border opens.

    Returns
    -------
    Mesh
        The cleaned mesh; vertices and faces keep their relative order, except those of split
        triangles.
    dict
        Counts: ``vertices_before`` and ``faces_before``; what was removed: ``merged`` (copies of
        vertices), ``degenerate_faces`` (two corners coincide, or no area), ``duplicate_faces`` and
        ``unreferenced`` (vertices).

    Raises
    ------
    InvalidMesh
        If the extent of the mesh is zero, or so small or large that areas underflow or overflow, if
        vertices are stray, or if coordinates in single precision are so far from the origin that
        they are rounded.
    """
    surface = compact(mesh.vertices, mesh.faces)
    extent_of(surface)
    _check_stray(surface.vertices)
    unit = np.sqrt(surface.area)
    distinct, place = _merge_copies(surface, COPIES * unit)
    faces = _proper(place[surface.faces])
    collapsed = mesh.n_faces - len(faces)
    faces, flat = _without_flat(distinct, faces, _FLAT * unit)
    single = np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])
    cleaned = compact(distinct, faces[single])
    return cleaned, {
        "vertices_before": mesh.n_vertices,
        "faces_before": mesh.n_faces,
        "merged": surface.n_vertices - len(distinct),
        "degenerate_faces": collapsed + flat,
        "duplicate_faces": len(faces) - len(single),
        "unreferenced": mesh.n_vertices - surface.n_vertices + len(distinct) - cleaned.n_vertices,
    }


def topology(mesh: Mesh) -> dict[str, int]:
    """Return the counts of ``components``, ``boundary_edges``, ``holes`` and what is not manifold.

    Boundary loops that share a vertex are one hole. One of ``non_manifold_edges`` has more than two
    faces, and the faces of one of ``non_manifold_vertices`` do not form a single fan.
    """
    counts = mesh.edges.counts
    return {
        "components": int(connected_components(mesh).max(initial=-1)) + 1,
        "boundary_edges": int((counts == 1).sum()),
        "holes": count_holes(mesh.edges.boundary),
        "non_manifold_edges": int((counts > 2).sum()),
        "non_manifold_vertices": int((fans_per_vertex(mesh) > 1).sum()),
    }


def count_holes(boundary: IntArray) -> int:
    """Return the number of connected components of boundary edges, shape (b, 2)."""
    vertices, ends = np.unique(boundary, return_inverse=True)
    tails, heads = ends.reshape(-1, 2).T
    return int(component_labels(tails, heads, len(vertices)).max(initial=-1)) + 1


@np.errstate(over="ignore")
def extent_of(mesh: Mesh) -> float:
    """Return the longest side of the bounding box; raises ``InvalidMesh`` if it is zero, out of range or rounded."""
    extent = float(np.ptp(mesh.vertices, axis=0).max()) if mesh.n_vertices else 0.0
    if not _EXTENTS[0] < extent < _EXTENTS[1]:
        problem = f"the bounding box of the mesh has extent {extent:g}"
        raise InvalidMesh(problem, "pass a surface of positive size in a unit that fits it")
    far = np.abs(mesh.vertices).max(axis=0)
    coarse = mesh.vertices[:, far * np.finfo(np.float32).eps > _COARSE * extent]
    if coarse.size and _were_single(coarse):
        problem = f"coordinates of {far.max():.7g} in single precision are too coarse for a size of {extent:.3g}"
        raise InvalidMesh(
            problem, "move it to the origin, or export coordinates in double precision"
        )
    return extent


def _were_single(numbers: FloatArray) -> bool:
    """Return whether numbers were in single precision before they were written, in shortest or fixed decimals."""
    single = numbers.astype(np.float32)
    if ((single == numbers) | (single.astype(str).astype(np.float64) == numbers)).all():
        return True
    decimals = next(
        (places for places in range(10) if (numbers.round(places) == numbers).all()), 10
    )
    is_telling = 2 * 10.0**-decimals < np.spacing(single)  # others would agree anyway
    return bool(
        (single.astype(np.float64).round(decimals) == numbers).all()
        and is_telling.sum() >= _FEWEST_TELLING
    )


def _check_stray(vertices: Points) -> None:
    distances = np.sort(np.linalg.norm(vertices - np.median(vertices, axis=0), axis=1))
    within = int(np.searchsorted(distances, _STRAY * distances[len(distances) // 2], side="right"))
    if within < len(distances) and distances[within] > 10 * distances[within - 1]:
        problem = f"{counted(len(distances) - within, 'vertex', 'vertices')} beyond {_STRAY} radii of the shape"
        raise InvalidMesh(problem, "remove stray vertices")


def make_manifold(mesh: Mesh) -> Mesh:
    """Return a mesh with at most two faces per edge and one fan of faces per vertex.

    An edge with more than two faces keeps the two largest: internal walls and slivers are dropped,
    and the surface around them stays connected. A vertex with several fans is split into one vertex
    per fan, at the same position.
    """
    faces, areas, edges = mesh.faces.astype(np.int64), mesh.face_areas, mesh.edges
    if (edges.counts > 2).any():
        # Rank of each side among the sides of its edge, largest face first; ties by face order.
        size = np.repeat(areas, 3)
        order = np.lexsort((np.arange(len(size)), -size, edges.of_sides))
        rank = (np.arange(len(size)) - edges.first[edges.of_sides[order]])[np.argsort(order)]
        keep = ~(rank.reshape(-1, 3) >= 2).any(axis=1)
        faces = faces[keep]
        edges = edges_of(faces)
    fan, owner = _fans(faces, edges)
    if len(faces) == mesh.n_faces and len(owner) == mesh.n_vertices:
        return mesh
    # Order fans by their vertex, so that a manifold mesh stays unchanged.
    order = np.argsort(owner, kind="stable")
    return Mesh(mesh.vertices[owner[order]], np.argsort(order)[fan].reshape(-1, 3).astype(np.int32))


def orient(mesh: Mesh, areas: FloatArray, piece: IntArray) -> tuple[Mesh, int, int]:
    """Orient the triangles of each piece of a manifold mesh alike.

    A piece is closed if its border is at most as long as the root of its area; it is oriented
    outwards. An open piece, or one without volume, keeps the orientation of most of its area.

    Parameters
    ----------
    mesh
        The mesh.
    areas, piece
        Its :func:`component_areas`.

    Returns
    -------
    Mesh
        The oriented mesh, or ``mesh`` itself if nothing is turned.
    turned, one_sided : int
        Number of turned triangles, and of pieces that cannot be oriented (such as a Moebius strip).
    """
    edges, (starts, ends) = mesh.edges, sides_of(mesh.faces)
    inner, rim = edges.first[edges.counts == 2], edges.grouped_sides[edges.first[edges.counts == 1]]
    one, other = edges.grouped_sides[inner], edges.grouped_sides[inner + 1]
    against, signs = starts[one] == starts[other], np.ones(mesh.n_faces)
    if against.any():
        import igl

        corners = np.sort(mesh.faces.astype(np.int64), axis=1)
        order = np.lexsort(corners.T[::-1])
        corners[order] = igl.bfs_orient(corners[order])[0]
        second = mesh.faces[
            np.arange(len(order)), ((mesh.faces == corners[:, :1]).argmax(axis=1) + 1) % 3
        ]
        signs = np.where(second == corners[:, 1], 1.0, -1.0)
    one_sided = len(np.unique(piece[one[against ^ (signs[one // 3] != signs[other // 3])] // 3]))
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    centres = weighted_means(middles, mesh.face_areas, piece)
    outwards = np.bincount(
        piece, signs * np.einsum("fk,fk->f", middles - centres[piece], mesh.face_normals)
    )
    lengths = np.linalg.norm(mesh.vertices[starts[rim]] - mesh.vertices[ends[rim]], axis=1)
    is_closed = np.bincount(piece[rim // 3], lengths, len(areas)) <= np.sqrt(areas)
    by_volume = is_closed & (np.abs(outwards) > _NO_VOLUME * areas**1.5)
    signs *= np.where(
        np.where(by_volume, outwards, np.bincount(piece, signs * mesh.face_areas)) < 0, -1, 1
    )[piece]
    turned = signs < 0
    if not turned.any():
        return mesh, 0, one_sided
    return (
        Mesh(mesh.vertices, np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)),
        int(turned.sum()),
        one_sided,
    )


def connected_components(mesh: Mesh) -> IntArray:
    """Label each vertex with its edge-connected component, shape (n,), numbered from 0 by first vertex.

    An isolated vertex is a separate component.
    """
    return component_labels(*sides_of(mesh.faces), mesh.n_vertices)


def largest_component(mesh: Mesh) -> Mesh:
    """Return the component with the largest area."""
    areas, of_face = component_areas(mesh)
    return (
        compact(mesh.vertices, mesh.faces[of_face == int(np.argmax(areas))]) if len(areas) else mesh
    )


def component_areas(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """Return the area of each component, shape (c,), and the component of each face, shape (m,)."""
    labels = connected_components(mesh)
    of_face = labels[mesh.faces[:, 0]]
    areas = np.bincount(of_face, mesh.face_areas, int(labels.max(initial=-1)) + 1)
    return areas.astype(np.float64), of_face


def compact(vertices: Points, faces: NDArray[np.integer]) -> Mesh:
    """Return the mesh of the given faces without unreferenced vertices, in the same order."""
    used = np.bincount(faces.ravel(), minlength=len(vertices)) > 0
    place = np.cumsum(used) - 1
    return Mesh(vertices[used], place[faces].astype(np.int32))


def fans_per_vertex(mesh: Mesh) -> IntArray:
    """Return the number of fans of edge-connected faces at each vertex, shape (n,): 1 on a manifold."""
    return np.bincount(
        _fans(mesh.faces.astype(np.int64), mesh.edges)[1], minlength=mesh.n_vertices
    ).astype(np.int64)


def merge_duplicates(vertices: Points) -> tuple[Points, IntArray]:
    """Return the distinct positions in order of first occurrence and the index of each vertex among them."""
    # Adding 0.0 makes negative zeros positive.
    _, first, group = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    return vertices[kept], np.searchsorted(kept, first)[group.ravel()]


def _merge_copies(surface: Mesh, distance: float) -> tuple[Points, IntArray]:
    """Merge vertices within a distance, transitively; as :func:`merge_duplicates`, at the mean of distinct positions.

    Where this merges some, rounding may have moved others farther apart, and borders are closed
    that are within :data:`SEAM` times the distance.
    """
    distinct, place = merge_duplicates(surface.vertices)
    groups = _near_groups(distinct, distance)
    if groups is None:
        return distinct, place
    equally = np.ones(len(distinct))
    rim = np.unique(edges_of(_proper(groups[place[surface.faces]])).boundary)
    at_rim = _near_groups(weighted_means(distinct, equally, groups)[rim], SEAM * distance)
    if at_rim is not None:
        first = np.arange(groups.max() + 1)
        first[rim] = rim[np.unique(at_rim, return_index=True)[1][at_rim]]
        groups = np.unique(first, return_inverse=True)[1].astype(np.int64)[groups]
    return weighted_means(distinct, equally, groups), groups[place]


def _near_groups(points: Points, distance: float) -> IntArray | None:
    """Return the group of each point, joined by chains of points within a distance; None if all are single."""
    from scipy.spatial import cKDTree  # lazy: most verbs clean nothing

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    n_pairs = tree.count_neighbors(tree, distance)  # of ordered pairs, with each point itself
    if n_pairs > _MOST_COPIES * len(points):
        raise InvalidMesh(
            f"most vertices lie within {distance:.3g} of {_MOST_COPIES} others",
            "remove stray faces",
        )
    if n_pairs == len(points):
        return None
    tails, heads = tree.query_pairs(distance, output_type="ndarray").T
    return component_labels(tails, heads, len(points))


def weighted_means(points: Points, weights: FloatArray, groups: IntArray) -> Points:
    """Return the weighted mean of the points of each group, shape (groups, 3)."""
    sums = np.stack([np.bincount(groups, weights * coordinate) for coordinate in points.T], axis=1)
    return np.asarray(sums / np.bincount(groups, weights)[:, np.newaxis])


def _proper(faces: IntArray) -> IntArray:
    """Return the triangles with three different corners."""
    return np.asarray(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])


def _without_flat(vertices: Points, faces: IntArray, height: float) -> tuple[IntArray, int]:
    """Split triangles at their longest sides where a neighbour is flat; returns them and how many were flat.

    In each round, all triangles at a longest side are split at the third corner of a flat one,
    which leaves nothing of the flat one itself. Choices follow the positions of vertices, not their
    numbers.
    """
    order, n_flat = np.arange(len(vertices)), 0
    for turn in range(_MOST_ROUNDS):
        corners = vertices[faces]
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        doubled = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        flat = np.flatnonzero(doubled <= height * lengths.max(axis=1))
        if not len(flat):
            return order[faces], n_flat
        if not turn:
            order, n_flat = np.lexsort(vertices.T), len(flat)
            vertices, faces = vertices[order], np.argsort(order)[faces]
        edges = edges_of(faces)
        at_sides, unsplit = edges.of_sides.reshape(-1, 3), len(edges.ends)
        longest = lengths[flat].argmax(axis=1)
        third = np.full(unsplit, len(vertices))
        np.minimum.at(third, at_sides[flat, longest], faces[flat, (longest + 2) % 3])
        chosen = np.where(third < len(vertices), np.arange(unsplit), unsplit)[at_sides]
        first = chosen.min(axis=1, keepdims=True)
        third[at_sides[chosen > first]] = len(vertices)  # a triangle changes once in a round
        face, side = np.nonzero(third[at_sides] < len(vertices))
        start, end, opposite = (faces[face, (side + k) % 3] for k in range(3))
        middle = third[at_sides[face, side]]
        halves = np.concatenate(
            [np.stack([start, middle, opposite]), np.stack([middle, end, opposite])], axis=1
        ).T
        faces = np.concatenate([np.delete(faces, face, axis=0), _proper(halves)])
    raise InvalidMesh("triangles without area cannot be removed", "remove or re-export the mesh")


def _fans(faces: IntArray, edges: Edges) -> tuple[IntArray, IntArray]:
    """Label each corner with its fan (edge-connected faces around its vertex), shape (3 m,); and the vertex of each."""
    # Consecutive sides of an edge share both end points; non-manifold edges chain all their faces.
    sides = np.delete(edges.grouped_sides, edges.first)
    previous = np.delete(edges.grouped_sides, edges.first + edges.counts - 1)
    vertex = faces.ravel()
    corners = np.stack(sides_of(np.arange(len(vertex)).reshape(-1, 3)))
    corners = np.take_along_axis(
        corners, vertex[corners].argsort(axis=0), axis=0
    )  # of each side, smaller vertex first
    fan = component_labels(corners[:, sides].ravel(), corners[:, previous].ravel(), len(vertex))
    owner = np.zeros(int(fan.max(initial=-1)) + 1, dtype=np.int64)
    owner[fan] = vertex
    return fan, owner


def component_labels(tails: IntArray, heads: IntArray, count: int) -> IntArray:
    """Return the connected component of each of ``count`` nodes of a graph from its edges, in order of first nodes."""
    from scipy.sparse import coo_array, csgraph  # lazy: the import takes a third of a second

    graph = coo_array((np.ones(len(tails), dtype=np.int8), (tails, heads)), shape=(count, count))
    return np.asarray(
        csgraph.connected_components(graph.tocsr(), directed=False)[1], dtype=np.int64
    )

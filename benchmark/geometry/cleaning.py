"""Repair of triangle meshes: duplicates, flat faces, loose vertices, and what is not manifold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Edges, FloatArray, IntArray, Mesh, Points, edges_of, sides_of
from benchmark.text import counted

LARGEST_AREA_LOSS = 0.25
"""Maximum fraction of the area that preparation may lose.

A leg is 18 % of the surface of a human body, an arm 9 % (the rule of nines of burn medicine): a
shape that has lost more than a quarter no longer shows the subject. Ordinary data sets lose far
less, see ``docs/data.md``.
"""

COPIES = 4e-6
"""Distance below which vertices are copies of one, in units of the root of the area.

Rounding moves copies apart. In the data sets of the suite, different vertices are at least forty
times as far apart.
"""

SEAM = 5
"""Distance between borders that are closed where copies were merged, in units of :data:`COPIES`."""

#: Height below which a triangle has no area, in units of the root of the area: rounding in
#: preparation could turn it over.
_FLAT = 2e-6

#: Distance from the centre beyond which vertices are stray, in units of the median distance, if
#: those within end at a fraction of it.
_STRAY = 100

#: That fraction, as a factor between the nearest stray vertex and the farthest other one.
_STRAY_GAP = 10

#: Most copies of a vertex at different positions.
_MOST_COPIES = 1000

#: Most rounds of splitting triangles.
_MOST_ROUNDS = 4096

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

#: Most decimals of numbers in fixed decimals.
_MOST_DECIMALS = 10


def clean(mesh: Mesh) -> tuple[Mesh, dict[str, int]]:
    """Remove the usual faults of mesh files.

    1. Vertices at (nearly) the same position are merged at their mean, so that triangles that are
       stored separately become neighbours.
    2. Triangles without area are removed. Where the corners of one lie on a line, the neighbour
       across its longest side is split at its third corner, so that no gap opens.
    3. Duplicates of triangles are removed, and vertices without triangles.

    Parameters
    ----------
    mesh
        Any triangle mesh.

    Returns
    -------
    Mesh
        The cleaned mesh; vertices and faces keep their relative order, except those of split
        triangles.
    dict of str to int
        The numbers ``vertices_before`` and ``faces_before``; and of what was removed, ``merged``
        (vertices that were copies), ``degenerate_faces`` (without area), ``duplicate_faces`` and
        ``unreferenced`` (vertices without triangles).

    Raises
    ------
    InvalidMesh
        If the extent of the mesh is zero, or so small or large that areas underflow or overflow, if
        vertices are stray, or if coordinates in single precision are so far from the origin that
        they are rounded.
    """
    surface = compact(mesh.vertices, mesh.faces)
    extent_of(surface)  # raises an error for a size that is zero or out of range
    _check_stray(surface.vertices)
    unit = np.sqrt(surface.area)
    distinct, place = _merge_copies(surface, COPIES * unit)
    faces = _proper(place[surface.faces])
    n_collapsed = mesh.n_faces - len(faces)
    faces, n_flat = _without_flat(distinct, faces, _FLAT * unit)
    # Triangles with the same three corners are duplicates, of which the first is kept.
    sorted_corners = np.sort(faces, axis=1)
    _, first_of_each = np.unique(sorted_corners, axis=0, return_index=True)
    single = np.sort(first_of_each)
    cleaned = compact(distinct, faces[single])
    return cleaned, {
        "vertices_before": mesh.n_vertices,
        "faces_before": mesh.n_faces,
        "merged": surface.n_vertices - len(distinct),
        "degenerate_faces": n_collapsed + n_flat,
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
    """Return the longest side of the bounding box of a mesh, in its units.

    Parameters
    ----------
    mesh
        A mesh whose vertices all belong to triangles.

    Raises
    ------
    InvalidMesh
        If the extent is zero or out of range, or if the coordinates were in single precision and so
        far from the origin that rounding has moved them visibly.
    """
    extent = float(np.ptp(mesh.vertices, axis=0).max()) if mesh.n_vertices else 0.0
    least, largest = _EXTENTS
    if not least < extent < largest:
        problem = f"the bounding box of the mesh has extent {extent:g}"
        raise InvalidMesh(problem, "pass a surface of positive size in a unit that fits it")
    farthest = np.abs(mesh.vertices).max(axis=0)  # along each axis
    rounding = farthest * np.finfo(np.float32).eps
    # Coordinates along the axes on which single precision would round visibly.
    coarse = mesh.vertices[:, rounding > _COARSE * extent]
    if coarse.size and _were_single(coarse):
        problem = (
            f"coordinates of {farthest.max():.7g} in single precision are too coarse "
            f"for a size of {extent:.3g}"
        )
        hint = "move it to the origin, or export coordinates in double precision"
        raise InvalidMesh(problem, hint)
    return extent


def _were_single(numbers: FloatArray) -> bool:
    """Return whether numbers were in single precision before they were written.

    They may have been written in shortest or in fixed decimals.
    """
    single = numbers.astype(np.float32)
    if ((single == numbers) | (single.astype(str).astype(np.float64) == numbers)).all():
        return True
    decimals = 0
    while decimals < _MOST_DECIMALS and not (numbers.round(decimals) == numbers).all():
        decimals += 1
    is_telling = 2 * 10.0**-decimals < np.spacing(single)  # others would agree anyway
    agree = single.astype(np.float64).round(decimals) == numbers
    return bool(agree.all() and is_telling.sum() >= _FEWEST_TELLING)


def _check_stray(vertices: Points) -> None:
    """Raise ``InvalidMesh`` if a few vertices lie far outside of all others."""
    distances = np.sort(np.linalg.norm(vertices - np.median(vertices, axis=0), axis=1))
    median = distances[len(distances) // 2]
    n_within = int(np.searchsorted(distances, _STRAY * median, side="right"))
    n_stray = len(distances) - n_within
    if n_stray and distances[n_within] > _STRAY_GAP * distances[n_within - 1]:
        count = counted(n_stray, "vertex", "vertices")
        problem = f"{count} beyond {_STRAY} radii of the shape"
        raise InvalidMesh(problem, "remove stray vertices")


def make_manifold(mesh: Mesh) -> Mesh:
    """Return a mesh with at most two faces at each edge and one fan of faces around each vertex.

    Of an edge with more than two faces, the two largest are kept, which drops inner walls and
    slivers. A fan consists of the faces around a vertex that are connected through its edges. A
    vertex with several fans is split into one vertex for each fan, at the same position.

    Parameters
    ----------
    mesh
        Any triangle mesh; it is returned itself if nothing has to change.
    """
    faces = mesh.faces.astype(np.int64)
    edges = mesh.edges
    if (edges.counts > 2).any():
        # The rank of a face at each of its edges by area; only ranks 0 and 1 are kept.
        ranks = _ranks_at_edges(mesh)
        faces = faces[(ranks < 2).all(axis=1)]
        edges = edges_of(faces)
    fan_of_corner, vertex_of_fan = _fans(faces, edges)
    if len(faces) == mesh.n_faces and len(vertex_of_fan) == mesh.n_vertices:
        return mesh
    # Each fan becomes a vertex; they are sorted by the vertices that they come from.
    order = np.argsort(vertex_of_fan, kind="stable")
    place_of_fan = np.argsort(order)
    corners = place_of_fan[fan_of_corner].reshape(-1, 3)
    return Mesh(mesh.vertices[vertex_of_fan[order]], corners.astype(np.int32))


def _ranks_at_edges(mesh: Mesh) -> IntArray:
    """Return the rank of each triangle at each of its three edges, shape (m, 3).

    At an edge, the largest triangle has rank 0; of equal ones, the first.
    """
    edges = mesh.edges
    sides = np.arange(3 * mesh.n_faces)
    areas = np.repeat(mesh.face_areas, 3)
    order = np.lexsort((sides, -areas, edges.of_sides))  # by edge, then largest first
    ranks_in_order = sides - edges.first[edges.of_sides[order]]
    return np.asarray(ranks_in_order[np.argsort(order)].reshape(-1, 3))


def orient(mesh: Mesh, areas: FloatArray, piece: IntArray) -> tuple[Mesh, int, int]:
    """Orient the triangles of each piece of a manifold mesh alike, and closed pieces outwards.

    A piece counts as closed if its border is at most as long as the root of its area. An open
    piece, or one without volume, gets the orientation that most of its area has.

    Parameters
    ----------
    mesh
        A manifold mesh.
    areas
        Area of each connected piece, shape (pieces,).
    piece
        Piece of each triangle, from 0, shape (m,).

    Returns
    -------
    mesh : Mesh
        The oriented mesh; the given object if no triangle is turned.
    n_turned : int
        Number of turned triangles.
    n_one_sided : int
        Number of pieces that cannot be oriented, such as a Moebius strip.
    """
    edges = mesh.edges
    starts, _ = sides_of(mesh.faces)
    # Each inner edge is a side of two triangles. If both sides run in the same direction, the
    # triangles are oriented differently.
    inner = edges.first[edges.counts == 2]
    first = edges.grouped_sides[inner]
    second = edges.grouped_sides[inner + 1]
    runs_alike = starts[first] == starts[second]
    signs = _consistent_signs(mesh) if runs_alike.any() else np.ones(mesh.n_faces)
    contradicts = runs_alike ^ (signs[first // 3] != signs[second // 3])
    n_one_sided = len(np.unique(piece[first[contradicts] // 3]))

    # Now the triangles of a piece are oriented alike, but the whole piece may face the wrong way.
    signs *= _signs_of_pieces(mesh, signs, areas, piece)[piece]
    turned = signs < 0
    if not turned.any():
        return mesh, 0, n_one_sided
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    return Mesh(mesh.vertices, faces), int(turned.sum()), n_one_sided


def _signs_of_pieces(
    mesh: Mesh, signs: FloatArray, areas: FloatArray, piece: IntArray
) -> NDArray[np.integer]:
    """Return -1 for each piece that must be turned as a whole, and 1 for the others.

    A closed piece with a volume is turned to face outwards. Any other piece is turned so that most
    of its area is oriented as before. A piece counts as closed if its borders are together no
    longer than the root of its area.

    Parameters
    ----------
    mesh
        The mesh.
    signs
        -1 for each triangle that is turned so that all triangles of its piece are oriented alike, 1
        for the others, shape (m,).
    areas
        Area of each piece, shape (pieces,).
    piece
        Piece of each triangle, shape (m,).

    Returns
    -------
    numpy.ndarray
        Shape (pieces,).
    """
    edges = mesh.edges
    starts, ends = sides_of(mesh.faces)
    # Lengths of the borders of the pieces: an edge of one triangle is on a border. The three sides
    # of a triangle have consecutive numbers.
    rim = edges.grouped_sides[edges.first[edges.counts == 1]]
    lengths = np.linalg.norm(mesh.vertices[starts[rim]] - mesh.vertices[ends[rim]], axis=1)
    border = np.bincount(piece[rim // 3], lengths, len(areas))
    is_closed = border <= np.sqrt(areas)

    # By the divergence theorem, the flux of the position through a closed surface is three times
    # its volume, with the sign of its orientation. Normals are as long as twice the area.
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    centres = weighted_means(middles, mesh.face_areas, piece)
    fluxes = np.einsum("fk,fk->f", middles - centres[piece], mesh.face_normals)
    outwards = np.bincount(piece, signs * fluxes)
    has_volume = np.abs(outwards) > _NO_VOLUME * areas**1.5

    majority = np.bincount(piece, signs * mesh.face_areas)
    decisive = np.where(is_closed & has_volume, outwards, majority)
    return np.where(decisive < 0, -1, 1)


def _consistent_signs(mesh: Mesh) -> FloatArray:
    """Return -1 for the triangles to turn so that those of each piece are oriented alike, else 1.

    The choice does not depend on the order of the triangles.
    """
    import igl

    corners = np.sort(mesh.faces.astype(np.int64), axis=1)
    order = np.lexsort(corners.T[::-1])
    corners[order] = igl.bfs_orient(corners[order])[0]
    first = (mesh.faces == corners[:, :1]).argmax(axis=1)
    second = mesh.faces[np.arange(len(order)), (first + 1) % 3]
    return np.where(second == corners[:, 1], 1.0, -1.0)


def connected_components(mesh: Mesh) -> IntArray:
    """Label each vertex with its edge-connected component, shape (n,).

    Components are numbered from 0 by their first vertices. An isolated vertex is a separate one.
    """
    return component_labels(*sides_of(mesh.faces), mesh.n_vertices)


def largest_component(mesh: Mesh) -> Mesh:
    """Return the component with the largest area."""
    areas, of_face = component_areas(mesh)
    if not len(areas):
        return mesh
    return compact(mesh.vertices, mesh.faces[of_face == int(np.argmax(areas))])


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
    """Return the number of fans of edge-connected faces at each vertex, shape (n,).

    It is 1 on a manifold.
    """
    _, owner = _fans(mesh.faces.astype(np.int64), mesh.edges)
    return np.bincount(owner, minlength=mesh.n_vertices).astype(np.int64)


def merge_duplicates(vertices: Points) -> tuple[Points, IntArray]:
    """Return the distinct positions, and the index of each vertex among them.

    Positions are in order of first occurrence.
    """
    # Adding 0.0 makes negative zeros positive.
    _, first, group = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    return vertices[kept], np.searchsorted(kept, first)[group.ravel()]


def _merge_copies(surface: Mesh, distance: float) -> tuple[Points, IntArray]:
    """Merge vertices that are connected by chains of short distances, at their mean.

    Where copies are merged, rounding may have moved others farther apart. Therefore vertices on the
    borders that remain are merged once more, within :data:`SEAM` times the distance.

    Parameters
    ----------
    surface
        The mesh.
    distance
        Distance within which vertices are copies, in units of the mesh.

    Returns
    -------
    positions : numpy.ndarray
        Merged positions, shape (k, 3).
    place : numpy.ndarray
        Index of each vertex of the mesh among them, shape (n,).

    Raises
    ------
    InvalidMesh
        If most vertices lie that near to very many others.
    """
    # Exact copies come first, so that each position counts once in a mean.
    distinct, place = merge_duplicates(surface.vertices)
    groups = _near_groups(distinct, distance)
    if groups is None:
        return distinct, place
    equally = np.ones(len(distinct))
    merged = weighted_means(distinct, equally, groups)
    # The second pass, for the vertices on borders. Groups that it joins stand for the first one.
    rim = np.unique(edges_of(_proper(groups[place[surface.faces]])).boundary)
    rim_groups = _near_groups(merged[rim], SEAM * distance)
    if rim_groups is not None:
        _, first_of_group = np.unique(rim_groups, return_index=True)
        stands_for = np.arange(len(merged))
        stands_for[rim] = rim[first_of_group[rim_groups]]
        _, wider_groups = np.unique(stands_for, return_inverse=True)
        groups = wider_groups.astype(np.int64)[groups]
    return weighted_means(distinct, equally, groups), groups[place]


def _near_groups(points: Points, distance: float) -> IntArray | None:
    """Group points that are connected by chains of points within a distance of each other.

    Parameters
    ----------
    points
        Coordinates, shape (n, 3).
    distance
        Largest distance of neighbours in a chain.

    Returns
    -------
    numpy.ndarray or None
        Group of each point, numbered from 0 by their first points, shape (n,); None if each point
        is alone in its group.

    Raises
    ------
    InvalidMesh
        If points have on average more than :data:`_MOST_COPIES` neighbours, whose pairs would not
        fit in memory.
    """
    from scipy.spatial import cKDTree  # lazy: most verbs clean nothing

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    n_pairs = tree.count_neighbors(tree, distance)  # of ordered pairs, with each point itself
    if n_pairs > _MOST_COPIES * len(points):
        problem = f"most vertices lie within {distance:.3g} of {_MOST_COPIES} others"
        raise InvalidMesh(problem, "remove stray faces")
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
    """Remove flat triangles, whose three corners lie on a line, without opening a gap.

    The third corner of a flat triangle lies on its longest side. The triangles at that side are
    split at the corner, which leaves nothing of the flat one. This is repeated in rounds. The
    result depends on the positions of the vertices, but not on their order.

    Parameters
    ----------
    vertices
        Positions, shape (n, 3).
    faces
        Triangles, shape (m, 3).
    height
        Height up to which a triangle is flat, in units of the mesh.

    Returns
    -------
    faces : numpy.ndarray
        Triangles that are not flat, shape (k, 3).
    n_flat : int
        How many of the given triangles were flat.

    Raises
    ------
    InvalidMesh
        If flat triangles remain after :data:`_MOST_ROUNDS` rounds.
    """
    # If there is a flat triangle, vertices are sorted by position for the time of the rounds; this
    # array maps their new indices to the given ones.
    order = np.arange(len(vertices))
    n_flat = 0
    for number in range(_MOST_ROUNDS):
        flat, longest = _flat_triangles(vertices[faces], height)
        if not len(flat):
            return order[faces], n_flat
        if number == 0:
            n_flat = len(flat)
            order = np.lexsort(vertices.T)
            vertices = vertices[order]
            faces = np.argsort(order)[faces]
        faces = _split_at_flat(faces, flat, longest, len(vertices))
    raise InvalidMesh("triangles without area cannot be removed", "remove or re-export the mesh")


def _flat_triangles(corners: FloatArray, height: float) -> tuple[IntArray, IntArray]:
    """Return the triangles at most as high as a height, and the longest side of each."""
    lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    flat = np.flatnonzero(doubled_areas <= height * lengths.max(axis=1))
    return flat, lengths[flat].argmax(axis=1)


def _split_at_flat(faces: IntArray, flat: IntArray, longest: IntArray, n_vertices: int) -> IntArray:
    """Split the triangles at the longest sides of flat triangles, in one round.

    Each triangle is split at most once.

    Parameters
    ----------
    faces
        All triangles, shape (m, 3).
    flat
        Indices of the flat triangles, shape (k,).
    longest
        The longest side of each flat triangle, shape (k,): side s runs from corner s to corner
        s + 1 (modulo 3).
    n_vertices
        Number of vertices.

    Returns
    -------
    numpy.ndarray
        The triangles afterwards, shape (l, 3); the halves of split ones stand at the end.
    """
    edges = edges_of(faces)
    edge_of_side = edges.of_sides.reshape(-1, 3)
    n_edges = len(edges.ends)
    # The vertex at which each edge is split: the third corner of a flat triangle, the one of the
    # least index if there are several. The number n_vertices means that an edge is not split.
    middle_of_edge = np.full(n_edges, n_vertices)
    opposite_longest = faces[flat, (longest + 2) % 3]
    np.minimum.at(middle_of_edge, edge_of_side[flat, longest], opposite_longest)
    # If several edges of a triangle would be split, only the first of them is.
    split_edges = np.where(middle_of_edge < n_vertices, np.arange(n_edges), n_edges)[edge_of_side]
    first_split = split_edges.min(axis=1, keepdims=True)
    middle_of_edge[edge_of_side[split_edges > first_split]] = n_vertices

    # Each triangle at a split edge becomes two, between the middle and the opposite corner.
    face, side = np.nonzero(middle_of_edge[edge_of_side] < n_vertices)
    start = faces[face, side]
    end = faces[face, (side + 1) % 3]
    opposite = faces[face, (side + 2) % 3]
    middle = middle_of_edge[edge_of_side[face, side]]
    halves = np.concatenate(
        [np.stack([start, middle, opposite]), np.stack([middle, end, opposite])], axis=1
    ).T
    # A flat triangle is split at its own corner: its halves have a corner twice, and are left out.
    return np.concatenate([np.delete(faces, face, axis=0), _proper(halves)])


def _fans(faces: IntArray, edges: Edges) -> tuple[IntArray, IntArray]:
    """Find the fans of a mesh: the sets of faces around a vertex that are connected by its edges.

    In a manifold, each vertex has one fan. A vertex at which two surfaces touch has two.

    Parameters
    ----------
    faces
        Triangles, shape (m, 3).
    edges
        Edges of the triangles.

    Returns
    -------
    fan_of_corner : numpy.ndarray
        Fan of each corner of each triangle, shape (3 m,).
    vertex_of_fan : numpy.ndarray
        Vertex of each fan, shape (fans,).
    """
    # Number the corners of all triangles. Find the two at the ends of each side of a triangle,
    # shape (2, sides), that of the smaller vertex first.
    vertex_of_corner = faces.ravel()
    corners = np.arange(len(vertex_of_corner)).reshape(-1, 3)
    ends = np.stack(sides_of(corners))
    smaller_first = vertex_of_corner[ends].argsort(axis=0)
    ends = np.take_along_axis(ends, smaller_first, axis=0)

    # Triangles at an edge are in the same fan of both of its ends: link the corners of each side
    # with those of the previous side on the same edge.
    sides = np.delete(edges.grouped_sides, edges.first)
    previous = np.delete(edges.grouped_sides, edges.first + edges.counts - 1)
    fan_of_corner = component_labels(
        ends[:, sides].ravel(), ends[:, previous].ravel(), len(vertex_of_corner)
    )
    vertex_of_fan = np.zeros(int(fan_of_corner.max(initial=-1)) + 1, dtype=np.int64)
    vertex_of_fan[fan_of_corner] = vertex_of_corner
    return fan_of_corner, vertex_of_fan


def component_labels(tails: IntArray, heads: IntArray, count: int) -> IntArray:
    """Return the connected component of each of ``count`` nodes of a graph from its edges.

    Components are numbered by their first nodes.
    """
    from scipy.sparse import coo_array, csgraph  # lazy: the import takes a third of a second

    graph = coo_array((np.ones(len(tails), dtype=np.int8), (tails, heads)), shape=(count, count))
    _, labels = csgraph.connected_components(graph.tocsr(), directed=False)
    return np.asarray(labels, dtype=np.int64)

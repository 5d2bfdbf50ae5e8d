"""Copies of a surface in one mesh, such as levels of detail and colliders, which are refused.

Two pieces are copies if each runs along the other over most of its area. A bridge between them
would make a body of twice the area, and which of the two is meant nobody can know.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from benchmark.errors import InvalidMesh
from benchmark.geometry.cleaning import component_labels, merge_duplicates
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, Points, sides_of

#: Share of the area of each of two pieces that runs along the other, above which they are copies.
LARGEST_SHARE_ALONG = 0.5

#: Distance within which surfaces run along each other, in units of the root of the smaller area.
NEAR = 0.03

#: Least share of the whole area of a piece that can be a copy: bridges join smaller ones.
_SMALLEST_SHARE_OF_AREA = 0.05

#: Most pieces among which copies are looked for, largest first.
_MOST_PIECES = 12

#: Points on each piece: neighbours are about half of NEAR apart.
_N_POINTS = 8000


def check_copies(mesh: Mesh) -> None:
    """Raise ``InvalidMesh`` if a mesh holds a surface twice, such as another level of detail.

    The mesh is divided into connected pieces, and every two large pieces are compared.

    Parameters
    ----------
    mesh
        Any triangle mesh; one without faces, or with NaN, passes here and is refused elsewhere.
    """
    if not mesh.n_faces or not np.isfinite(mesh.vertices).all():
        return
    # First pass, by position: faces are connected if they have a corner at the same place.
    _, vertex_at_position = merge_duplicates(mesh.vertices)
    piece_of_face = _piece_of_face(vertex_at_position[mesh.faces])
    is_one_piece = not piece_of_face.any()
    if is_one_piece:
        # Second pass, by number: faces are connected if they have a vertex in common. A coarser
        # copy keeps some positions of its original, which connect both in the first pass.
        piece_of_face = _piece_of_face(mesh.faces.astype(np.int64))
        # A texture cuts a surface into many patches, each with vertices of its own.
        are_patches = piece_of_face.max() >= _MOST_PIECES
        if are_patches:
            return
    if piece_of_face.any():
        _check_pieces(mesh, piece_of_face)


def _piece_of_face(faces: IntArray) -> IntArray:
    """Return the piece that each face belongs to, from 0."""
    labels = component_labels(*sides_of(faces), int(faces.max()) + 1)
    return np.unique(labels[faces[:, 0]], return_inverse=True)[1]


def _check_pieces(mesh: Mesh, piece_of_face: IntArray) -> None:
    """Raise ``InvalidMesh`` if two large pieces of a mesh lie along each other, as copies do.

    Points are spread over each piece. Two pieces are copies if more than half of the points of
    either piece lie near the other.

    Parameters
    ----------
    mesh
        The mesh.
    piece_of_face
        Piece of each triangle, from 0, shape (m,).
    """
    # The largest pieces, without those that are too small to be copies.
    areas = np.bincount(piece_of_face, mesh.face_areas)
    largest = np.argsort(-areas, kind="stable")[:_MOST_PIECES]
    smallest_area = _SMALLEST_SHARE_OF_AREA * areas.sum()
    large = [int(piece) for piece in largest if areas[piece] > smallest_area]
    points = {piece: _points_on(mesh, np.flatnonzero(piece_of_face == piece)) for piece in large}
    for first, second in combinations(large, 2):
        distance = NEAR * np.sqrt(min(areas[first], areas[second]))
        share = min(
            _share_along(points[first], points[second], distance),
            _share_along(points[second], points[first], distance),
        )
        if share > LARGEST_SHARE_ALONG:
            problem = (
                f"two of its {len(areas)} pieces run along each other over {share:.0%} of their "
                "area: a copy, such as a level of detail, a collider or a variant"
            )
            raise InvalidMesh(problem, "export the surface once")


def _points_on(mesh: Mesh, faces: IntArray) -> Points:
    """Return points that are spread over faces by their areas, the same in each call."""
    areas = mesh.face_areas[faces]
    steps = (np.arange(_N_POINTS) + 0.5) / _N_POINTS * areas.sum()
    chosen = faces[np.minimum(np.searchsorted(np.cumsum(areas), steps), len(faces) - 1)]
    random = np.random.default_rng(0).random((2, _N_POINTS))
    root = np.sqrt(random[0])
    weights = np.stack([1 - root, root * (1 - random[1]), root * random[1]], axis=1)
    return np.asarray(np.einsum("nk,nkd->nd", weights, mesh.vertices[mesh.faces[chosen]]))


def _share_along(points: Points, others: Points, distance: float) -> float:
    """Return the share of points within a distance of the nearest of some others."""
    distances: FloatArray = cKDTree(others).query(points, distance_upper_bound=distance)[0]
    return float(np.isfinite(distances).mean())

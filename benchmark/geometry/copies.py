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

    The mesh is divided into pieces, of which two are compared at a time. Faces are of one piece if
    vertices at the same position connect them. As a coarser copy may share positions with its
    original, a mesh of a single such piece is divided again, into faces that share vertices by
    number, unless that leaves many pieces, as the seams of textures do.
    """
    if not mesh.n_faces or not np.isfinite(mesh.vertices).all():
        return  # which is refused elsewhere
    # Pieces whose vertices lie at the same positions.
    _, merged_vertex = merge_duplicates(mesh.vertices)
    piece_of_face = _piece_of_face(merged_vertex[mesh.faces])
    is_single = not piece_of_face.any()
    if is_single:
        # Pieces whose vertices have the same numbers; very many are patches of a texture.
        piece_of_face = _piece_of_face(mesh.faces.astype(np.int64))
        if piece_of_face.max() >= _MOST_PIECES:
            return
    if piece_of_face.any():
        _check_pieces(mesh, piece_of_face)


def _piece_of_face(faces: IntArray) -> IntArray:
    """Return the piece that each face belongs to, from 0."""
    labels = component_labels(*sides_of(faces), int(faces.max()) + 1)
    return np.unique(labels[faces[:, 0]], return_inverse=True)[1]


def _check_pieces(mesh: Mesh, piece_of_face: IntArray) -> None:
    """Raise ``InvalidMesh`` if two large pieces of a mesh run along each other, as copies do.

    Points are spread over each piece. Two pieces run along each other if more than half of the
    points of each lie near the other.

    Parameters
    ----------
    mesh
        The mesh.
    piece_of_face
        Number of the piece of each triangle, from 0, shape (m,).
    """
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

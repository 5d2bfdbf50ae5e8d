"""Topological shortcuts: nearby parts are fused, as scanners and marching cubes fuse a hand and a hip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from benchmark.errors import UnsupportedShape
from benchmark.geometry.cleaning import extent_of
from benchmark.geometry.mesh import Mesh

#: Minimum distance along the edges between two triangles to be joined, as a fraction of the longest side of the
#: bounding box, and as a multiple of their Euclidean distance.
FARTHEST, DETOUR = 0.3, 2.0

#: Number of candidate triangles for one end of a shortcut.
TRIED = 100


def shortcuts(mesh: Mesh, amount: float, random: np.random.Generator) -> Mesh:
    """Join the given number of triangle pairs, near in space and far along the surface, by tubes.

    Among the candidates, the nearest pairs are joined first: hands to hips, or the knees. A tube replaces its two
    triangles by six, so the surface stays a manifold and its genus increases by one.

    Raises
    ------
    UnsupportedShape
        If there are fewer such pairs.
    """
    starts = random.permutation(mesh.n_faces)[:TRIED]
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    along = _ways(mesh, mesh.faces[starts, 0])[:, mesh.faces[:, 0]]
    straight = np.linalg.norm(middles[starts][:, None] - middles[None], axis=2)
    distant = (along > FARTHEST * extent_of(mesh)) & (along > DETOUR * straight)
    distant &= _facing(mesh, middles, starts)
    straight[~distant] = np.inf
    partners = straight.argmin(axis=1)
    gaps = straight[np.arange(len(starts)), partners]
    used = np.zeros(mesh.n_vertices, dtype=bool)
    removed = np.zeros(mesh.n_faces, dtype=bool)
    tubes: list[NDArray[np.int64]] = []
    for number in np.argsort(gaps, kind="stable"):
        first, second = mesh.faces[starts[number]], mesh.faces[partners[number]]
        if len(tubes) == int(amount) or not np.isfinite(gaps[number]):
            break
        if used[first].any() or used[second].any():
            continue
        # Adjacent tubes would act as a single shortcut.
        middle = middles[starts[number]]
        used |= np.linalg.norm(mesh.vertices - middle, axis=1) < FARTHEST / 5 * extent_of(mesh)
        used[first], used[second] = True, True
        removed[[starts[number], partners[number]]] = True
        tubes.append(_tube(mesh.vertices, first, second))
    if len(tubes) < int(amount):
        raise UnsupportedShape(
            f"the surface comes near itself at {len(tubes)} places, fewer than {int(amount)}",
            "choose a smaller strength",
        )
    return Mesh(mesh.vertices, np.concatenate([mesh.faces[~removed], *tubes]))


def _facing(mesh: Mesh, middles: NDArray[np.float64], starts: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return whether the outer sides of two triangles face each other, so that a tube lies outside, shape (k, m)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    if np.einsum("ij,ij", a, normals) < 0:  # six times the volume is negative: the mesh is inside out
        normals = -normals
    own, other = np.einsum("ij,ij->i", middles, normals), middles @ normals[starts].T
    ahead = own[starts][:, None] < other.T
    behind = middles[starts] @ normals.T > own[None]
    return np.asarray(ahead & behind)


def _ways(mesh: Mesh, sources: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return the shortest path lengths along edges, shape (k, n)."""
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).astype(np.int64)
    sides = np.unique(np.sort(sides, axis=1), axis=0)
    lengths = np.linalg.norm(mesh.vertices[sides[:, 0]] - mesh.vertices[sides[:, 1]], axis=1)
    graph = coo_array((lengths, sides.T), shape=(mesh.n_vertices, mesh.n_vertices)).tocsr()
    return np.asarray(dijkstra(graph, directed=False, indices=sources))


def _tube(vertices: NDArray[np.float64], first: NDArray[np.integer], second: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return six triangles between two facing triangles, with the rotation that gives the shortest tube."""
    around = second[::-1]
    turns = [np.roll(around, k) for k in range(3)]
    lengths = [np.linalg.norm(vertices[first] - vertices[turn], axis=1).sum() for turn in turns]
    other = turns[int(np.argmin(lengths))]
    faces = []
    for k in range(3):
        a, b, c, d = first[k], first[(k + 1) % 3], other[k], other[(k + 1) % 3]
        faces += [(a, b, c), (b, d, c)]
    return np.array(faces, dtype=np.int64)

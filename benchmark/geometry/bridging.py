"""Joining of mesh components by short triangle strips, so that geodesics between all vertices exist."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.errors import InvalidMesh
from benchmark.geometry.cleaning import compact, connected_components
from benchmark.geometry.mesh import Mesh, Points, edges_of

IntArray = NDArray[np.int64]
_Edge = tuple[int, int]


def bridge_components(mesh: Mesh) -> tuple[Mesh, int]:
    """Join all components into one along their minimum spanning tree.

    The distance between two components is the shortest Euclidean distance between their vertices (boundary vertices
    for an open component). Each link of the tree becomes a strip of two triangles between one boundary edge at each
    end, so every edge has at most two faces. The edges of a bridge replace the boundary edges that it uses, so another
    bridge can start at the same vertex. The strip joins boundary edges that run in opposite directions, if possible, to
    keep the orientation consistent. Coincident ends are welded, and one triangle closes the gap between their boundary
    edges. A closed component is first opened by removing the smallest triangle at the anchor.

    Parameters
    ----------
    mesh
        A manifold mesh with any number of components; isolated vertices are dropped.

    Returns
    -------
    mesh : Mesh
        One component; the remaining vertices keep their order.
    bridges : int
        Number of joined components minus one.

    Raises
    ------
    InvalidMesh
        If the mesh has no faces.
    """
    if not mesh.n_faces:
        raise InvalidMesh("a mesh without faces cannot be bridged", "pass a surface")
    work = compact(mesh.vertices, mesh.faces)
    labels = connected_components(work)
    links = _spanning_tree(work, labels)
    if not links:
        return work, 0
    builder = _Builder(work)
    for first, second in links:
        builder.bridge(first, second)
    return builder.result(), len(links)


def _spanning_tree(mesh: Mesh, labels: IntArray) -> list[_Edge]:
    """Return the vertex pairs of the minimum spanning tree of the components, by Prim's algorithm from component 0."""
    count = int(labels.max()) + 1
    if count == 1:
        return []
    candidates = _anchor_candidates(mesh, labels)
    members = [candidates[labels[candidates] == component] for component in range(count)]
    trees = [cKDTree(mesh.vertices[member]) for member in members]
    lower, upper = np.array([tree.mins for tree in trees]), np.array([tree.maxes for tree in trees])
    distance = np.full(count, np.inf)
    link: list[_Edge] = [(-1, -1)] * count
    outside = np.ones(count, dtype=bool)
    links: list[_Edge] = []
    current = 0
    while True:
        outside[current] = False
        if not outside.any():
            return links
        gap = np.maximum(np.maximum(lower - upper[current], lower[current] - upper), 0.0)
        near = np.linalg.norm(gap, axis=1)  # bounding boxes spare most pairs the search
        for other in np.flatnonzero(outside & (near < distance)):
            bridge = _closest(mesh.vertices, members, trees, current, int(other), distance[other])
            if bridge is not None:
                distance[other], link[other] = bridge
        current = int(np.argmin(np.where(outside, distance, np.inf)))
        links.append(link[current])


def _closest(
    vertices: Points, members: list[IntArray], trees: list[cKDTree], inside: int, other: int, limit: float
) -> tuple[float, _Edge] | None:
    """Return the closest pair (vertex inside, vertex of the other component) if it is closer than the limit."""
    few, many = (inside, other) if len(members[inside]) < len(members[other]) else (other, inside)
    distances, nearest = trees[many].query(vertices[members[few]], distance_upper_bound=limit)
    at = int(np.argmin(distances))
    if not distances[at] < limit:
        return None
    ends = {few: int(members[few][at]), many: int(members[many][nearest[at]])}
    return float(distances[at]), (ends[inside], ends[other])


def _anchor_candidates(mesh: Mesh, labels: IntArray) -> IntArray:
    """Return the boundary vertices of open components and all vertices of closed ones."""
    on_boundary = np.zeros(mesh.n_vertices, dtype=bool)
    on_boundary[edges_of(mesh.faces).boundary] = True
    is_open = np.zeros(int(labels.max()) + 1, dtype=bool)
    is_open[labels[on_boundary]] = True
    return np.flatnonzero(on_boundary | ~is_open[labels])


class _Builder:
    """Mutable faces of a mesh for adding bridges; visits only the neighbourhoods of the anchors."""

    def __init__(self, mesh: Mesh) -> None:
        self._vertices = mesh.vertices
        self._faces: list[list[int] | None] = mesh.faces.tolist()
        corners = mesh.faces.ravel()
        self._by_vertex = np.argsort(corners, kind="stable") // 3
        self._first = np.concatenate(([0], np.cumsum(np.bincount(corners, minlength=mesh.n_vertices))))
        self._changed: dict[int, list[int]] = {}
        self._welded: dict[int, int] = {}

    def bridge(self, first: int, second: int) -> None:
        """Join two vertices of different components."""
        first, second = self._resolve(first), self._resolve(second)
        pairs = [(a, b) for a in self._free_neighbours(first) for b in self._free_neighbours(second)]
        a, b = min(
            pairs, key=lambda pair: (self._runs(first, pair[0]) == self._runs(second, pair[1]), self._gap(*pair))
        )
        forward = self._runs(first, a)
        if self._gap(first, second) == 0:
            self._weld(second, first)
            if self._gap(a, b) == 0:
                self._weld(b, a)
                return
            strip = [(a, first, b)]
        elif self._gap(first, b) <= self._gap(a, second):
            strip = [(a, first, b), (first, second, b)]
        else:
            strip = [(a, first, second), (a, second, b)]
        # If a side runs from first to a in its face, it must run from a to first in the new triangle.
        for x, y, z in strip:
            self._add([x, y, z] if forward else [y, x, z])

    def result(self) -> Mesh:
        """Return the mesh with its bridges."""
        return compact(self._vertices, np.array([face for face in self._faces if face is not None], dtype=np.int64))

    def _around(self, vertex: int) -> list[int]:
        """Return the faces at a vertex."""
        if vertex not in self._changed:
            self._changed[vertex] = self._by_vertex[self._first[vertex] : self._first[vertex + 1]].tolist()
        return self._changed[vertex]

    def _corners(self, index: int) -> list[int]:
        return self._faces[index] or []

    def _add(self, face: list[int]) -> None:
        self._faces.append(face)
        for vertex in face:
            self._around(vertex).append(len(self._faces) - 1)

    def _remove(self, index: int) -> None:
        for vertex in self._corners(index):
            self._around(vertex).remove(index)
        self._faces[index] = None

    def _weld(self, vertex: int, onto: int) -> None:
        for index in self._around(vertex):
            self._faces[index] = [onto if corner == vertex else corner for corner in self._corners(index)]
        self._changed[onto] = self._around(onto) + self._around(vertex)
        self._welded[vertex] = onto

    def _resolve(self, vertex: int) -> int:
        while vertex in self._welded:
            vertex = self._welded[vertex]
        return vertex

    def _free_neighbours(self, vertex: int) -> list[int]:
        """Return the far ends of the boundary edges at a vertex; open a closed fan by removing its smallest face."""
        neighbours = self._boundary(vertex)
        if not neighbours:
            self._remove(min(self._around(vertex), key=lambda index: (self._area(index), index)))
            neighbours = self._boundary(vertex)
        return neighbours

    def _boundary(self, vertex: int) -> list[int]:
        ends = [end for index in self._around(vertex) for end in self._corners(index) if end != vertex]
        return sorted(end for end in set(ends) if ends.count(end) == 1)

    def _runs(self, start: int, end: int) -> bool:
        """Return whether the boundary edge runs from start to end in its face."""
        face = next(corners for index in self._around(start) if end in (corners := self._corners(index)))
        return face[(face.index(start) + 1) % 3] == end

    def _gap(self, first: int, second: int) -> float:
        return math.dist(self._vertices[first], self._vertices[second])

    def _area(self, index: int) -> float:
        a, b, c = self._vertices[self._corners(index)]
        return float(np.linalg.norm(np.cross(b - a, c - a)))

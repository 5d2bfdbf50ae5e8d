"""Joining of mesh components by short triangle strips, so that geodesics between all vertices exist."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.errors import InvalidMesh
from benchmark.geometry.cleaning import compact, connected_components
from benchmark.geometry.mesh import Mesh, Points, edges_of

IntArray = NDArray[np.int64]
_Link = tuple[float, int, int]


def bridge_components(mesh: Mesh) -> tuple[Mesh, list[float]]:
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
    gaps : list of float
        Length of each link, in units of the mesh; one fewer than there were components.

    Raises
    ------
    InvalidMesh
        If the mesh has no faces.
    """
    if not mesh.n_faces:
        raise InvalidMesh("a mesh without faces cannot be bridged", "pass a surface")
    work = compact(mesh.vertices, mesh.faces)
    labels = connected_components(work)
    if not labels.any():
        return work, []
    builder = _Builder(work)
    gaps = []
    for gap, first, second in _in_order_of_growth(_spanning_tree(work, labels), labels):
        builder.bridge(first, second)
        gaps.append(gap)
    return builder.result(), gaps


def _spanning_tree(mesh: Mesh, labels: IntArray) -> list[_Link]:
    """Return the links of the minimum spanning tree of the components [Boruvka 1926].

    In each round, every group of joined components is linked to the nearest other group.
    """
    places = _anchor_candidates(mesh, labels)
    points, group = mesh.vertices[places], labels[places].copy()
    links: list[_Link] = []
    while group.any():
        distances, nearest = _nearest_of_other_groups(points, group)
        order = np.lexsort((np.arange(len(group)), distances, group))
        best = order[np.unique(group[order], return_index=True)[1]]
        for at in best[np.argsort(distances[best], kind="stable")]:
            other = int(nearest[at])
            one, two = sorted((int(group[at]), int(group[other])))
            if one != two:  # otherwise joined in this round
                links.append((float(distances[at]), int(places[at]), int(places[other])))
                group[group == two] = one
    return links


def _nearest_of_other_groups(points: Points, group: IntArray) -> tuple[NDArray[np.float64], IntArray]:
    """Return, for each point, the distance and the index of the nearest point of another group.

    Two groups differ in a bit of their numbers, so the nearest of all points of other groups is the nearest among those
    that differ in some bit.
    """
    distances, nearest = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    for bit in range(int(group.max()).bit_length()):
        is_set = (group >> bit & 1).astype(bool)
        for own, other in ((is_set, ~is_set), (~is_set, is_set)):
            if own.any() and other.any():
                found, at = cKDTree(points[other]).query(points[own])
                closer = found < distances[own]
                rows = np.flatnonzero(own)[closer]
                distances[rows], nearest[rows] = found[closer], np.flatnonzero(other)[at[closer]]
    return distances, nearest


def _in_order_of_growth(links: list[_Link], labels: IntArray) -> Iterator[_Link]:
    """Yield the links of a tree as Prim's algorithm finds them from component 0, each with its known end first."""
    at: dict[int, list[_Link]] = {}
    for gap, one, two in links:
        at.setdefault(int(labels[one]), []).append((gap, one, two))
        at.setdefault(int(labels[two]), []).append((gap, two, one))
    waiting = list(at[0])
    heapq.heapify(waiting)
    joined = {0}
    while waiting:
        link = heapq.heappop(waiting)
        component = int(labels[link[2]])
        if component not in joined:
            joined.add(component)
            yield link
            for further in at[component]:
                heapq.heappush(waiting, further)


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
            self._remove(min(self._around(vertex), key=lambda index: (self._pinches(index), self._area(index), index)))
            neighbours = self._boundary(vertex)
        return neighbours

    def _pinches(self, index: int) -> int:
        """Return at how many corners of a face two holes would meet without it."""
        corners = set(self._corners(index))
        return sum(len(set(self._boundary(corner)) ^ (corners - {corner})) > 2 for corner in corners)

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

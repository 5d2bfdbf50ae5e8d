"""Joining of mesh components by short triangle strips, so that geodesics between all vertices exist."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from benchmark.geometry.cleaning import compact, connected_components
from benchmark.geometry.mesh import IntArray, Mesh


def bridge_components(mesh: Mesh) -> tuple[Mesh, list[float]]:
    """Join all components into one along their minimum spanning tree.

    The distance between two components is the shortest Euclidean distance between their vertices
    (boundary vertices for an open component). Each link of the tree becomes a strip of two
    triangles between one boundary edge at each end, so every edge has at most two faces. The edges
    of a bridge replace the boundary edges that it uses, so another bridge can start at the same
    vertex. The strip joins boundary edges that run in opposite directions, if possible, to keep the
    orientation consistent. Coincident ends are welded, and one triangle closes the gap between
    their boundary edges. A closed component is first opened by removing the smallest triangle at
    the anchor.

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
    """
    work = compact(mesh.vertices, mesh.faces)
    labels = connected_components(work)
    if not labels.any():
        return work, []
    builder = _Builder(work)
    gaps = []
    for gap, first, second in _links(work, labels):
        builder.bridge(first, second)
        gaps.append(gap)
    return builder.result(), gaps


def _links(mesh: Mesh, labels: IntArray) -> Iterator[tuple[float, int, int]]:
    """Yield the links of the minimum spanning tree of the components as they are found from component 0 [Prim 1957].

    A link is the distance from a vertex of the joined components to one of a new component, and
    these two vertices.
    """
    anchors = _anchor_candidates(mesh, labels)
    points, component = mesh.vertices[anchors], labels[anchors]
    gaps, nearest = np.full(len(anchors), np.inf), np.zeros(len(anchors), dtype=np.int64)
    added, outside = 0, np.arange(len(anchors))
    while len(outside := outside[component[outside] != added]):
        members = np.flatnonzero(component == added)
        distances, at = cKDTree(points[members]).query(points[outside])
        closer = distances < gaps[outside]
        gaps[outside[closer]], nearest[outside[closer]] = distances[closer], members[at[closer]]
        end = outside[gaps[outside].argmin()]
        added = component[end]
        yield float(gaps[end]), int(anchors[nearest[end]]), int(anchors[end])


def _anchor_candidates(mesh: Mesh, labels: IntArray) -> IntArray:
    """Return the boundary vertices of open components and all vertices of closed ones."""
    on_boundary = np.isin(np.arange(mesh.n_vertices), mesh.edges.boundary)
    return np.flatnonzero(on_boundary | ~np.isin(labels, labels[on_boundary]))


class _Builder:
    """Faces of a mesh and the faces around each vertex, to which bridges are added."""

    def __init__(self, mesh: Mesh) -> None:
        self._vertices = mesh.vertices
        self._faces: dict[int, list[int]] = {}
        self._around: list[list[int]] = [[] for _ in range(mesh.n_vertices)]
        self._next = 0
        for face in mesh.faces.tolist():
            self._add(face)
        self._welded: dict[int, int] = {}

    def bridge(self, first: int, second: int) -> None:
        """Join two vertices of different components."""
        first, second = self._resolve(first), self._resolve(second)
        pairs = [
            (a, b) for a in self._free_neighbours(first) for b in self._free_neighbours(second)
        ]
        a, b = min(
            pairs,
            key=lambda pair: (
                self._runs(first, pair[0]) == self._runs(second, pair[1]),
                self._gap(*pair),
            ),
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
        # If a side runs from first to a in its face, it must run from a to first in the new
        # triangle.
        for x, y, z in strip:
            self._add([x, y, z] if forward else [y, x, z])

    def result(self) -> Mesh:
        """Return the mesh with its bridges."""
        return compact(self._vertices, np.array(list(self._faces.values()), dtype=np.int64))

    def _add(self, face: list[int]) -> None:
        for vertex in face:
            self._around[vertex].append(self._next)
        self._faces[self._next] = face
        self._next += 1

    def _remove(self, index: int) -> None:
        for vertex in self._faces.pop(index):
            self._around[vertex].remove(index)

    def _weld(self, vertex: int, onto: int) -> None:
        for index in self._around[vertex]:
            self._faces[index] = [
                onto if corner == vertex else corner for corner in self._faces[index]
            ]
        self._around[onto] += self._around[vertex]
        self._welded[vertex] = onto

    def _resolve(self, vertex: int) -> int:
        while vertex in self._welded:
            vertex = self._welded[vertex]
        return vertex

    def _free_neighbours(self, vertex: int) -> list[int]:
        """Return the far ends of the boundary edges at a vertex; open a closed fan by removing its smallest face."""
        if not self._boundary(vertex):
            self._remove(
                min(
                    self._around[vertex],
                    key=lambda index: (self._pinches(index), self._area(index), index),
                )
            )
        return self._boundary(vertex)

    def _pinches(self, index: int) -> int:
        """Return at how many corners of a face two holes would meet without it."""
        corners = set(self._faces[index])
        return sum(
            len(set(self._boundary(corner)) ^ (corners - {corner})) > 2 for corner in corners
        )

    def _boundary(self, vertex: int) -> list[int]:
        ends = [
            end for index in self._around[vertex] for end in self._faces[index] if end != vertex
        ]
        return sorted(end for end in set(ends) if ends.count(end) == 1)

    def _runs(self, start: int, end: int) -> bool:
        """Return whether the boundary edge runs from start to end in its face."""
        face = next(
            corners for index in self._around[start] if end in (corners := self._faces[index])
        )
        return face[(face.index(start) + 1) % 3] == end

    def _gap(self, first: int, second: int) -> float:
        return math.dist(self._vertices[first], self._vertices[second])

    def _area(self, index: int) -> float:
        a, b, c = self._vertices[self._faces[index]]
        return float(np.linalg.norm(np.cross(b - a, c - a)))

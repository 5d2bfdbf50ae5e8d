"""Joining of mesh components by triangle strips, so that all geodesics exist."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from benchmark.geometry.cleaning import compact, connected_components
from benchmark.geometry.mesh import IntArray, Mesh


def bridge_components(mesh: Mesh) -> tuple[Mesh, list[float]]:
    """Join all components of a mesh into one, along their minimum spanning tree.

    The distance between two components is the shortest distance between their vertices, or between
    their boundary vertices if they are open. Each link of the tree becomes a bridge: a strip of two
    triangles between a boundary edge of either component. A bridge leaves boundary edges of its
    own, so that another one can start at the same vertex, and no edge gets more than two faces. If
    possible, the two boundary edges run in opposite directions, which keeps the orientation.

    Two vertices at the same position become one. A closed component is first opened by removing the
    smallest triangle at the end of the bridge.

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
    """Yield the links of the minimum spanning tree of the components, by Prim's algorithm [1957].

    The tree grows from component 0: each link adds the nearest component that is still outside.

    Parameters
    ----------
    mesh
        The mesh.
    labels
        Component of each vertex, from 0, shape (n,).

    Yields
    ------
    gap : float
        Length of the link, in units of the mesh.
    first : int
        Vertex at its end in the tree.
    second : int
        Vertex at its end in the component that is added.
    """
    # Anchors are the vertices at which a link may end.
    anchors = _anchor_candidates(mesh, labels)
    points = mesh.vertices[anchors]
    component_of = labels[anchors]
    # For each anchor, the nearest anchor in the tree, and its distance.
    gaps = np.full(len(anchors), np.inf)
    nearest = np.zeros(len(anchors), dtype=np.int64)
    newest_component = 0
    outside = np.flatnonzero(component_of != newest_component)
    while len(outside):
        # Only the newest component can be nearer to an anchor than the rest of the tree.
        members = np.flatnonzero(component_of == newest_component)
        distances, member_of = cKDTree(points[members]).query(points[outside])
        is_closer = distances < gaps[outside]
        closer = outside[is_closer]
        gaps[closer] = distances[is_closer]
        nearest[closer] = members[member_of[is_closer]]
        next_anchor = outside[gaps[outside].argmin()]
        yield (
            float(gaps[next_anchor]),
            int(anchors[nearest[next_anchor]]),
            int(anchors[next_anchor]),
        )
        newest_component = component_of[next_anchor]
        outside = outside[component_of[outside] != newest_component]


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
        """Join two components by a strip of triangles from vertex to vertex.

        The strip connects a boundary edge at each of the two vertices by two triangles. Vertices at
        the same position become one, which leaves one triangle, or none.

        Parameters
        ----------
        first, second
            Vertices of different components. Earlier bridges may have merged them with others.
        """
        first = self._resolve(first)
        second = self._resolve(second)
        # The other ends of the two boundary edges.
        beside_first, beside_second = self._facing_edges(first, second)
        first_edge_runs_forward = self._runs(first, beside_first)
        if self._gap(first, second) == 0:
            self._weld(second, first)
            if self._gap(beside_first, beside_second) == 0:
                self._weld(beside_second, beside_first)
                return
            strip = [[beside_first, first, beside_second]]
        elif self._gap(first, beside_second) <= self._gap(beside_first, second):
            strip = [[beside_first, first, beside_second], [first, second, beside_second]]
        else:
            strip = [[beside_first, first, second], [beside_first, second, beside_second]]
        # Triangles at an edge are oriented alike if they run through it in opposite directions. The
        # strip is listed for a first edge that its component runs through forward.
        for triangle in strip:
            if not first_edge_runs_forward:
                triangle[:2] = triangle[1], triangle[0]
            self._add(triangle)

    def _facing_edges(self, first: int, second: int) -> tuple[int, int]:
        """Return the far ends of the boundary edges at two vertices that a bridge joins.

        Edges that run in opposite directions come first, then near ones.
        """

        def rank(ends: tuple[int, int]) -> tuple[bool, float]:
            a, b = ends
            return self._runs(first, a) == self._runs(second, b), self._gap(a, b)

        return min(product(self._free_neighbours(first), self._free_neighbours(second)), key=rank)

    def result(self) -> Mesh:
        """Return the mesh with its bridges."""
        return compact(self._vertices, np.array(list(self._faces.values()), dtype=np.int64))

    def _add(self, face: list[int]) -> None:
        """Add a face."""
        for vertex in face:
            self._around[vertex].append(self._next)
        self._faces[self._next] = face
        self._next += 1

    def _remove(self, index: int) -> None:
        """Remove a face."""
        for vertex in self._faces.pop(index):
            self._around[vertex].remove(index)

    def _weld(self, vertex: int, onto: int) -> None:
        """Replace a vertex by another one in all faces."""
        for index in self._around[vertex]:
            self._faces[index] = [
                onto if corner == vertex else corner for corner in self._faces[index]
            ]
        self._around[onto] += self._around[vertex]
        self._welded[vertex] = onto

    def _resolve(self, vertex: int) -> int:
        """Return the vertex by which a vertex was replaced; itself if it was not."""
        while vertex in self._welded:
            vertex = self._welded[vertex]
        return vertex

    def _free_neighbours(self, vertex: int) -> list[int]:
        """Return the far ends of the boundary edges at a vertex.

        A closed fan is opened: its smallest face is removed.
        """

        def rank(index: int) -> tuple[int, float, int]:
            return self._pinches(index), self._area(index), index

        if not self._boundary(vertex):
            self._remove(min(self._around[vertex], key=rank))
        return self._boundary(vertex)

    def _pinches(self, index: int) -> int:
        """Return at how many corners of a face two holes would meet without it."""
        corners = set(self._faces[index])
        n_pinches = 0
        for corner in corners:
            ends = set(self._boundary(corner)) ^ (corners - {corner})
            n_pinches += len(ends) > 2
        return n_pinches

    def _boundary(self, vertex: int) -> list[int]:
        """Return the far ends of the boundary edges at a vertex, ascending."""
        counts = Counter[int]()
        for index in self._around[vertex]:
            counts.update(self._faces[index])
        return sorted(end for end, count in counts.items() if count == 1 and end != vertex)

    def _runs(self, start: int, end: int) -> bool:
        """Return whether the boundary edge runs from start to end in its face."""
        for index in self._around[start]:
            face = self._faces[index]
            if end in face:
                return face[(face.index(start) + 1) % 3] == end
        raise ValueError("no such edge")

    def _gap(self, first: int, second: int) -> float:
        """Return the distance between two vertices."""
        return math.dist(self._vertices[first], self._vertices[second])

    def _area(self, index: int) -> float:
        """Return twice the area of a face."""
        a, b, c = self._vertices[self._faces[index]]
        return float(np.linalg.norm(np.cross(b - a, c - a)))

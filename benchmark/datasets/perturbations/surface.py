"""Perturbations of a surface, as pure functions of the mesh, an amount and a random generator.

Random draws do not depend on the amount, so strengths differ only in the amount. Lengths are fractions of the longest
side of the bounding box.
"""

from __future__ import annotations

import numpy as np

from benchmark.errors import UnsupportedShape
from benchmark.geometry.cleaning import compact, extent_of, largest_component
from benchmark.geometry.mesh import Mesh, edges_of
from benchmark.geometry.preparation import decimate, isotropic_remesh

Random = np.random.Generator

#: Radius of a hole.
HOLE_RADIUS = 0.02
#: Minimum number of vertices of a perturbed shape.
FEWEST_VERTICES = 50
#: Re-meshing iterations.
ROUNDS = 5


def noise(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Add independent Gaussian noise to every vertex, with the given standard deviation per coordinate."""
    return mesh.with_vertices(mesh.vertices + amount * extent_of(mesh) * random.standard_normal((mesh.n_vertices, 3)))


def holes(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut the given number of round holes at random positions; keep the largest piece."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    running = np.cumsum(mesh.face_areas)
    centres = middles[np.searchsorted(running, running[-1] * random.uniform(size=int(amount)) * (1 - 1e-12))]
    radius = HOLE_RADIUS * extent_of(mesh)
    near = (np.linalg.norm(middles[:, None] - centres[None], axis=2) < radius).any(axis=1)
    return _rest(mesh, ~near)


def missing_parts(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut off the outermost fraction of the area in a random direction; keep the largest piece."""
    direction = random.standard_normal(3)
    along = mesh.vertices[mesh.faces].mean(axis=1) @ (direction / np.linalg.norm(direction))
    order = np.argsort(along, kind="stable")
    running = np.cumsum(mesh.face_areas[order])
    kept = np.zeros(mesh.n_faces, dtype=bool)
    kept[order[running <= (1 - amount) * running[-1]]] = True
    return _rest(mesh, kept)


def resolution(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Change the number of vertices: halve all edges until there are enough, then collapse edges."""
    while mesh.n_vertices < amount:
        mesh = _halved(mesh)
    return decimate(mesh, int(amount))


def remeshing(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Re-mesh the surface isotropically with the given edge length."""
    return isotropic_remesh(mesh, amount * extent_of(mesh), iterations=ROUNDS, feature_degrees=30.0)


def _rest(mesh: Mesh, kept: np.ndarray) -> Mesh:
    """Return the largest piece of the kept triangles."""
    rest = compact(mesh.vertices, mesh.faces[kept])
    if rest.n_faces:
        rest = largest_component(rest)
    if rest.n_vertices < FEWEST_VERTICES:
        raise UnsupportedShape(
            f"the perturbation leaves {rest.n_vertices} vertices of the shape", "choose a smaller strength"
        )
    return rest


def _halved(mesh: Mesh) -> Mesh:
    """Split each triangle into four at the edge midpoints."""
    edges = edges_of(mesh.faces)
    of_sides = edges.of_sides.reshape(-1, 3) + mesh.n_vertices
    tails = np.empty(len(edges.counts), dtype=np.int64)
    heads = np.empty_like(tails)
    sides = mesh.faces.astype(np.int64)
    for k in range(3):
        tails[edges.of_sides.reshape(-1, 3)[:, k]] = sides[:, k]
        heads[edges.of_sides.reshape(-1, 3)[:, k]] = sides[:, (k + 1) % 3]
    middles = (mesh.vertices[tails] + mesh.vertices[heads]) / 2
    (a, b, c), (ab, bc, ca) = sides.T, of_sides.T
    faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return Mesh(np.concatenate([mesh.vertices, middles]), faces)

"""Time and memory of the deforming methods, and of the elastic step against libigl."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from baselines._kernels.arap import AsRigidAsPossible
from baselines.constrained_mds import ConstrainedMDS
from baselines.mesh_unfolding import MeshUnfolding
from baselines.skeleton import Skeleton
from benchmark.api.contracts import Mesh, Shape
from tests.baselines.deformable import capsule, implicit_surface, tube
from tools.speed._timing import alternately, least_seconds, row

STEPS = 50
REPEATS = 3
MOST_SECONDS = 2.0
MOST_MEBIBYTES = 600
LARGEST_DIFFERENCE = 1e-2
LIMBS = np.array(
    [[-1.2, 0.0, 0.9], [-1.2, 0.5, -0.9], [1.1, -0.5, -1.0], [1.2, 0.4, -0.8], [-1.2, -0.6, -0.9], [1.4, 0.1, 0.7]]
)


def body() -> Mesh:
    """A trunk with a head, a tail and four legs, 2000 vertices."""

    def distance(points: np.ndarray) -> np.ndarray:
        trunk = capsule(points, [-0.7, 0, 0], [0.7, 0, 0], 0.35)
        limbs = [capsule(points, [0.7 * np.sign(end[0]), 0, 0], end, 0.14) for end in LIMBS]
        return np.min([trunk, *limbs], axis=0)

    return implicit_surface(distance, extent=1.8, resolution=80, n_vertices=2000)


def peak_mebibytes(function: Callable[[], Any]) -> float:
    """Largest memory that numpy and Python held during a run."""
    tracemalloc.start()
    try:
        function()
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def elastic_steps() -> dict[str, Any]:
    """Time as many local and global steps as libigl takes, from the same start under the same handles.

    The tube has no obtuse pair of angles, whose negative weights libigl keeps: both minimise the same energy.
    """
    import igl

    mesh = tube(1.0, rings=84, sides=24)
    shape = Shape(identifier="tube", mesh=mesh)
    order = mesh.vertices[:, 0].argsort()
    handles = np.concatenate([order[:20], order[-20:]])
    goals = mesh.vertices[handles] + np.repeat([[0.0, 0.0, 0.2], [0.0, 0.0, -0.2]], 20, axis=0)
    pull = np.zeros(mesh.n_vertices)
    pull[handles] = 1e6
    targets = np.zeros_like(mesh.vertices)
    targets[handles] = goals
    start = mesh.vertices.copy()
    start[handles] = goals
    surface = AsRigidAsPossible.of(shape)

    def ours() -> np.ndarray:
        solve = surface.factorise(pull)
        positions = start
        for _ in range(STEPS):
            positions = solve(surface.load(surface.rotations(positions)) + pull[:, None] * targets)
        return positions

    def peer() -> np.ndarray:
        data = igl.ARAPData()
        data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
        data.max_iter = STEPS
        igl.arap_precomputation(mesh.vertices, mesh.faces.astype(np.int64), 3, handles.astype(np.int32), data)
        return np.asarray(igl.arap_solve(goals, data, mesh.vertices.copy()))

    difference = float(np.linalg.norm(ours() - peer(), axis=1).mean())
    seconds, peer_seconds = alternately(ours, peer, REPEATS)
    return row(
        f"as-rigid-as-possible, {STEPS} steps",
        seconds,
        peer="libigl ARAP (spokes)",
        peer_seconds=peer_seconds,
        target="no slower, with the same result",
        met=seconds <= peer_seconds and difference <= LARGEST_DIFFERENCE,
        detail=f"{mesh.n_vertices} vertices, mean distance between the two results {difference:.1e}",
    )


def measure() -> list[dict[str, Any]]:
    """Time the elastic step and each method at 2000 vertices; geodesics are computed beforehand."""
    mesh = body()
    shape = Shape(identifier="body", mesh=mesh)
    shape.geodesics()
    rows = [elastic_steps()]
    for method in (ConstrainedMDS(), MeshUnfolding(), Skeleton()):
        seconds = least_seconds(lambda method=method: method.canonicalise(shape), REPEATS)
        form = method.canonicalise(shape)
        memory = peak_mebibytes(lambda method=method: method.canonicalise(shape))
        rows.append(
            row(
                f"{method.info.name}, given the geodesics"
                if method.info.name == "constrained-mds"
                else method.info.name,
                seconds,
                target=f"at most {MOST_SECONDS:.0f} s and {MOST_MEBIBYTES} MiB",
                met=seconds <= MOST_SECONDS and memory <= MOST_MEBIBYTES,
                detail=f"{mesh.n_vertices} vertices, peak {memory:.0f} MiB, "
                f"mean edge strain {form.notes['mean_edge_strain']:.3f}",
                peak_mebibytes=memory,
            )
        )
    return rows

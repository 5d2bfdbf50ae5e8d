"""Canonical forms beside other programs, on one body of 2000 vertices."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh
from sklearn.manifold import smacof as sklearn_smacof

from baselines._kernels.arap import AsRigidAsPossible
from baselines._kernels.smacof import normalised_stress, smacof
from baselines.classic_mds import classic_scaling
from baselines.non_metric_mds import non_metric_scaling
from benchmark.api.contracts import Mesh, Method, Shape
from benchmark.datasets.humans import Humans
from benchmark.geometry.preparation import prepare
from benchmark.plugins.registry import methods, variant
from tests.baselines.deformable import tube
from tools.speed.timing import Row, alternately, least

FloatArray = NDArray[np.float64]
REPEATS = 5
FEW_ROWS = ("accelerated-mds", "fast-classical-scaling", "nystrom-mds", "fast-mds")
#: Iterations of scikit-learn's non-metric scaling, whose whole run takes minutes.
NON_METRIC_ITERATIONS = 10
ELASTIC_STEPS = 50


def measure() -> Iterator[Row]:
    """Methods given the geodesics, those that ask for a few rows of them, and the elastic step."""
    humans = Humans()
    shape = Shape(identifier="body", mesh=prepare(humans.load(humans.entries[-1])).mesh)
    distances = shape.geodesics()
    ours, peer = alternately(partial(classic_scaling, distances), partial(_arpack_scaling, distances), REPEATS)
    yield Row(
        "classic-mds, given the geodesics",
        ours,
        "the three largest eigenpairs of 2000 vertices",
        "double centring + scipy eigsh",
        peer,
    )
    yield _least_squares(shape, distances)
    yield _non_metric(shape, distances)
    for name in FEW_ROWS:
        yield _few_rows(name, shape)
    yield _elastic_steps()


def _method(name: str) -> Method:
    method = variant(name, methods()).create()
    assert isinstance(method, Method)
    return method


def _least_squares(shape: Shape, distances: FloatArray) -> Row:
    """The whole form; scikit-learn starts at the same vertices and stops where plain majorisation stops."""
    method, start = _method("least-squares-mds"), shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    iterations = smacof(distances, start).iterations
    peer_points: list[FloatArray] = []
    peer = least(lambda: peer_points.append(_sklearn(distances, start, iterations)), 1)
    stress = method.canonicalise(shape).notes["stress"]
    detail = f"stress {stress:.5f} (peer {normalised_stress(peer_points[-1], distances):.5f})"
    ours = least(partial(method.canonicalise, shape), REPEATS)
    return Row("least-squares-mds, given the geodesics", ours, detail, "sklearn.manifold.smacof", peer)


def _non_metric(shape: Shape, distances: FloatArray) -> Row:
    method, start = _method("non-metric-mds"), _method("classic-mds").canonicalise(shape).vertices
    peer_points: list[FloatArray] = []
    peer = least(lambda: peer_points.append(_sklearn(distances, start, NON_METRIC_ITERATIONS, metric=False)), 1)
    # scikit-learn leaves the scale to the number of points.
    scaled = peer_points[-1] * np.linalg.norm(start) / np.linalg.norm(peer_points[-1])
    other = non_metric_scaling(distances, scaled, max_iterations=0)[1][0]
    detail = f"root of the stress {method.canonicalise(shape).notes['stress_1']:.5f} (peer {other:.5f})"
    name = f"sklearn.manifold.smacof(metric=False), {NON_METRIC_ITERATIONS} iterations"
    return Row(
        "non-metric-mds, given the geodesics", least(partial(method.canonicalise, shape), REPEATS), detail, name, peer
    )


def _few_rows(name: str, shape: Shape) -> Row:
    """A method that asks for some rows of geodesics, against all pairs and classic scaling, both from the bare mesh."""

    def from_mesh(method: Method) -> object:
        # A new mesh, for which no geodesic graph is remembered.
        mesh = Mesh(shape.mesh.vertices.copy(), shape.mesh.faces.copy())
        return method.canonicalise(Shape(identifier="body", mesh=mesh))

    method, peer = _method(name), _method("classic-mds")
    ours, peer_seconds = alternately(partial(from_mesh, method), partial(from_mesh, peer), REPEATS)
    stresses = [normalised_stress(m.canonicalise(shape).vertices, shape.geodesics()) for m in (method, peer)]
    detail = f"stress over all pairs {stresses[0]:.5f} (peer {stresses[1]:.5f})"
    return Row(f"{name} with its geodesics", ours, detail, "all geodesics + classic-mds", peer_seconds)


def _elastic_steps() -> Row:
    """As many local and global steps as libigl takes, from the same start under the same handles.

    The tube has no obtuse pair of angles, whose negative weights libigl keeps: both minimise the same energy.
    """
    mesh = tube(1.0, rings=84, sides=24)
    order = mesh.vertices[:, 0].argsort()
    handles = np.concatenate([order[:20], order[-20:]])
    goals = mesh.vertices[handles] + np.repeat([[0.0, 0.0, 0.2], [0.0, 0.0, -0.2]], 20, axis=0)
    pull = np.zeros(mesh.n_vertices)
    pull[handles] = 1e6
    targets = np.zeros_like(mesh.vertices)
    targets[handles] = goals
    start = mesh.vertices.copy()
    start[handles] = goals
    surface = AsRigidAsPossible.of(Shape(identifier="tube", mesh=mesh))

    def ours() -> FloatArray:
        solve = surface.factorise(pull)
        positions = start
        for _ in range(ELASTIC_STEPS):
            positions = solve(surface.load(surface.rotations(positions)) + pull[:, None] * targets)
        return positions

    def peer() -> FloatArray:
        data = igl.ARAPData()
        data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
        data.max_iter = ELASTIC_STEPS
        igl.arap_precomputation(mesh.vertices, mesh.faces.astype(np.int64), 3, handles.astype(np.int32), data)
        return np.asarray(igl.arap_solve(goals, data, mesh.vertices.copy()))

    difference = float(np.linalg.norm(ours() - peer(), axis=1).mean())
    seconds, peer_seconds = alternately(ours, peer, REPEATS)
    detail = f"{mesh.n_vertices} vertices, mean distance between the results {difference:.0e}"
    return Row(f"as-rigid-as-possible, {ELASTIC_STEPS} steps", seconds, detail, "libigl ARAP (spokes)", peer_seconds)


def _arpack_scaling(distances: FloatArray) -> FloatArray:
    squared = distances**2
    means = squared.mean(axis=0)
    values, vectors = eigsh(-0.5 * (squared - means - means[:, None] + means.mean()), k=3, which="LA")
    return np.asarray(vectors[:, ::-1] * np.sqrt(values[::-1]))


def _sklearn(distances: FloatArray, start: FloatArray, iterations: int, *, metric: bool = True) -> FloatArray:
    points, _ = sklearn_smacof(
        distances, metric=metric, n_components=3, init=start, n_init=1, max_iter=iterations, eps=0
    )
    return np.asarray(points)

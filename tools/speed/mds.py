"""Time of the scaling methods against their peers, on one body of 2000 vertices and one thread."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh, splu
from sklearn.manifold import smacof as sklearn_smacof

from baselines._kernels.smacof import normalised_stress, smacof
from baselines.accelerated_mds import AcceleratedMDS
from baselines.classic_mds import ClassicMDS, classic_scaling
from baselines.fast_mds import FastMDS
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.non_metric_mds import NonMetricMDS, non_metric_scaling
from baselines.nystrom_mds import NystromMDS
from baselines.spectral_mds import SpectralMDS
from benchmark.api.contracts import Mesh, Method, Shape
from benchmark.datasets.humans import Humans
from benchmark.geometry.geodesic_graph import geodesic_graph
from benchmark.geometry.preparation import prepare
from tools.speed._limits import Limit
from tools.speed._timing import alternately, least_seconds, processor_seconds, row

FloatArray = NDArray[np.float64]
REPEATS = 5
MORE_REPEATS = 15
OF_LIMIT = 3.0
"""Times that a method may take of the time in which its bytes can be moved and its operations done."""

BYTES_TO_SORT = 16 + 4 + 8 + 3 * 16 + 24
"""Of a pair of non-metric scaling: both its distances read, the key read, key and names written, three digits dealt,
and both vertices and the end of the tie made of them."""

BYTES_OF_A_PASS = 16 + 32 + 24
"""Of a pair: its indices read and its distance written; that distance read twice with the end of its tie and the
disparity written; indices, distance and disparity read for the gradient."""

DIGITS, VERTICES_OF_A_PASS = 3, 6
"""Of a pair, found by an index: a place for each digit of its key; both vertices for the distance, both again for the
gradient, and both of their sums."""

BYTES_OF_AN_ARC = 12
"""Of the graph: its end, and its length in single precision."""


def measure() -> list[dict[str, Any]]:
    """Compare each scaling method with what it replaces."""
    humans = Humans()
    shape = Shape(identifier="body", mesh=prepare(humans.load(humans.entries[-1])).mesh)
    distances = shape.geodesics()
    start = classic_scaling(distances)[0]
    return [
        classic(distances),
        least_squares(distances, start),
        least_squares_form(shape),
        non_metric(distances, start),
        non_metric_form(shape),
        *sampled(shape),
    ]


def classic(distances: FloatArray) -> dict[str, Any]:
    """Our eigenpairs against double centring and ARPACK on the full matrix."""
    ours, peer = alternately(partial(classic_scaling, distances), partial(_arpack_scaling, distances), REPEATS)
    found, expected = classic_scaling(distances)[0], _arpack_scaling(distances)
    expected *= np.sign((found * expected).sum(axis=0))
    miss = np.abs(found - expected).max() / np.abs(expected).max()
    return row(
        "classic-mds, given the geodesics",
        ours,
        peer="double centring + scipy eigsh",
        peer_seconds=peer,
        target="at least 2 times faster",
        met=peer >= 2 * ours and miss <= 1e-8,
        detail=f"largest relative difference of a coordinate {miss:.1e}",
    )


def least_squares(distances: FloatArray, start: FloatArray) -> dict[str, Any]:
    """One Guttman transform with its stress."""
    few, many = 5, 45
    ours, peer = _per_iteration(
        lambda iterations: smacof(distances, start, max_iterations=iterations, rtol=0),
        lambda iterations: _sklearn(distances, start, iterations),
        few,
        many,
    )
    stress = smacof(distances, start, max_iterations=few, rtol=0).stress[-1]
    other = normalised_stress(_sklearn(distances, start, few), distances)
    return row(
        "least-squares-mds, one iteration",
        ours,
        peer="sklearn.manifold.smacof",
        peer_seconds=peer,
        target="at least 25 times faster at equal stress",
        met=peer >= 25 * ours and abs(stress - other) <= 1e-9,
        detail=f"stress after {few} iterations from the same start {stress:.9f} (peer {other:.9f})",
    )


def least_squares_form(shape: Shape) -> dict[str, Any]:
    """The whole method against scikit-learn from the same start, which stops where plain majorisation stops."""
    method = LeastSquaresMDS()
    distances = shape.geodesics()
    plain = smacof(distances, shape.mesh.vertices)
    centred = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    peer = partial(_sklearn, distances, centred, plain.iterations)
    ours, peer_seconds = least_seconds(lambda: method.canonicalise(shape), REPEATS), processor_seconds(peer)
    form = method.canonicalise(shape)
    return row(
        "least-squares-mds, whole form",
        ours,
        peer="sklearn.manifold.smacof",
        peer_seconds=peer_seconds,
        target="at most 30 ms, at no more stress",
        met=ours <= 0.03 and form.notes["stress"] <= plain.stress[-1],
        detail=f"stress {form.notes['stress']:.5f} after {form.notes['iterations']} passes over all pairs "
        f"(peer {plain.stress[-1]:.5f} after {plain.iterations})",
    )


def non_metric_form(shape: Shape) -> dict[str, Any]:
    """The whole method against some iterations of scikit-learn from the same start."""
    method = NonMetricMDS()
    distances, start = shape.geodesics(), ClassicMDS().canonicalise(shape).vertices
    iterations = 10
    points: list[FloatArray] = []

    def peer() -> None:
        points.append(_sklearn(distances, start, iterations, metric=False))

    ours, peer_seconds = least_seconds(lambda: method.canonicalise(shape), REPEATS), processor_seconds(peer)
    other = _stress_1(points[0], distances, start)
    form = method.canonicalise(shape)
    pairs, passes = len(start) * (len(start) - 1) / 2, int(form.notes["iterations"]) + 1
    limit = Limit.of(
        moved=pairs * (BYTES_TO_SORT + passes * BYTES_OF_A_PASS),
        roots=pairs * passes,
        looks=pairs * (DIGITS + passes * VERTICES_OF_A_PASS),
    )
    return row(
        "non-metric-mds, whole form",
        ours,
        peer=f"sklearn.manifold.smacof(metric=False), {iterations} iterations",
        peer_seconds=peer_seconds,
        target=f"at most {OF_LIMIT:g} times the limit, at no more stress",
        met=ours <= OF_LIMIT * limit.seconds and form.notes["stress_1"] <= other,
        detail=f"{limit}; root of the normalised stress {form.notes['stress_1']:.5f} after {form.notes['iterations']} "
        f"passes over all pairs (peer {other:.5f})",
        limit_seconds=limit.seconds,
    )


def non_metric(distances: FloatArray, start: FloatArray) -> dict[str, Any]:
    """One isotonic regression with one Guttman transform."""
    few, many = 2, 6
    ours, peer = _per_iteration(
        lambda iterations: non_metric_scaling(distances, start, max_iterations=iterations, rtol=0),
        lambda iterations: _sklearn(distances, start, iterations, metric=False),
        few,
        many,
    )
    stress = non_metric_scaling(distances, start, max_iterations=many, rtol=0)[1][-1]
    other_stress = _stress_1(_sklearn(distances, start, many, metric=False), distances, start)
    return row(
        "non-metric-mds, one iteration",
        ours,
        peer="sklearn.manifold.smacof(metric=False)",
        peer_seconds=peer,
        target="at least 25 times faster at equal stress, within 1 %",
        met=peer >= 25 * ours and stress <= 1.01 * other_stress,
        detail=f"root of the normalised stress after {many} iterations from the same start {stress:.5f} "
        f"(peer {other_stress:.5f})",
    )


def _stress_1(points: FloatArray, distances: FloatArray, start: FloatArray) -> float:
    """Kruskal's stress of positions; scikit-learn leaves their scale to the number of points."""
    scaled = points * np.linalg.norm(start) / np.linalg.norm(points)
    return non_metric_scaling(distances, scaled, max_iterations=0)[1][0]


def sampled(shape: Shape) -> list[dict[str, Any]]:
    """Methods that need a few rows of geodesics, against all pairs and classic scaling, all from the bare mesh."""

    def from_mesh(method: Method) -> object:
        # A new mesh, for which no geodesic graph is remembered.
        mesh = Mesh(shape.mesh.vertices.copy(), shape.mesh.faces.copy())
        return method.canonicalise(Shape(identifier="body", mesh=mesh))

    def stress(method: Method) -> float:
        return normalised_stress(method.canonicalise(shape).vertices, shape.geodesics())

    def limit(method: Method) -> Limit:
        """The graph, which all need; for each row of distances its arcs read once; and for eigenpairs, Lanczos."""
        notes = method.canonicalise(shape).notes
        moved = float(notes.get("rows", notes.get("samples", 0))) * BYTES_OF_AN_ARC * len(graph.heads)
        steps = 2 * (int(notes.get("eigenfunctions", -1)) + 1) + 1  # the basis that the eigenpairs come from
        if steps == 1:
            return Limit.of(moved, the_graph=of_graph)
        factor = splu(shape.laplacian().stiffness.tocsc()[1:, 1:], permc_spec="MMD_AT_PLUS_A")
        solve = least_seconds(lambda: factor.solve(shape.mesh.vertices[1:, 0]), MORE_REPEATS)
        sums = 2 * shape.mesh.n_vertices * steps**2
        return Limit.of(moved, sums=sums, the_graph=of_graph, **{f"{steps}_solves": steps * solve})

    graph, of_graph = geodesic_graph(shape.mesh), least_seconds(lambda: geodesic_graph(shape.mesh), MORE_REPEATS)
    peer = ClassicMDS()
    peer_stress = stress(peer)
    rows = []
    sampling: tuple[tuple[str, Method, float], ...] = (
        ("accelerated-mds", AcceleratedMDS(), 1.05),
        ("spectral-mds", SpectralMDS(), 1.2),
        ("spectral-mds[samples=75]", SpectralMDS(samples=75), 1.2),
        ("nystrom-mds", NystromMDS(), 1.05),
        ("fast-mds", FastMDS(), np.inf),
    )
    for name, method, share in sampling:
        ours, peer_seconds = alternately(partial(from_mesh, method), partial(from_mesh, peer), MORE_REPEATS)
        found, least = stress(method), limit(method)
        bound = f" with at most {share - 1:.0%} more stress" if np.isfinite(share) else ""
        rows.append(
            row(
                f"{name} with its geodesics",
                ours,
                peer="all geodesics + classic-mds",
                peer_seconds=peer_seconds,
                target=f"at most {OF_LIMIT:g} times the limit{bound}",
                met=ours <= OF_LIMIT * least.seconds and found <= share * peer_stress,
                detail=f"{least}, or {peer_seconds / least.seconds:.1f} times faster than the other program; "
                f"stress over all pairs {found:.5f} (peer {peer_stress:.5f})",
                limit_seconds=least.seconds,
            )
        )
    return rows


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


def _per_iteration(
    ours: Callable[[int], object], peer: Callable[[int], object], few: int, many: int
) -> tuple[float, float]:
    """Seconds per iteration, without what is done once: the difference of two runs over that of their lengths."""
    short = alternately(partial(ours, few), partial(peer, few), REPEATS)
    long = alternately(partial(ours, many), partial(peer, many), REPEATS)
    our_seconds, peer_seconds = ((b - a) / (many - few) for a, b in zip(short, long, strict=True))
    return our_seconds, peer_seconds

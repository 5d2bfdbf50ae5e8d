"""Time of the further forms against plain implementations, on one body of 2000 vertices and one thread."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import minimize
from scipy.spatial.distance import pdist, squareform

from baselines._kernels.sampling import farthest_points
from baselines._kernels.smacof import normalised_stress
from baselines._kernels.spectral import distances_under
from baselines._kernels.springs import Springs
from baselines.subspace_mds import SubspaceMDS
from benchmark.api.contracts import Method, Shape
from benchmark.datasets.humans import Humans
from benchmark.geometry.laplacian import eigenpairs
from benchmark.geometry.preparation import prepare
from benchmark.methods.registry import methods, variant
from tools.speed._timing import alternately, least_seconds, row

FloatArray = NDArray[np.float64]
REPEATS = 3
MOST_SECONDS = 2.0
GIVEN_GEODESICS = (
    "least-squares-mds[metric=diffusion]",
    "least-squares-mds[metric=commute-time]",
    "feature-preserved",
    "euclidean-distance",
    "euclidean-distance[points=local]",
)


def measure() -> list[dict[str, Any]]:
    """Compare each form with what it replaces, or with the time that it may take."""
    humans = Humans()
    shape = Shape(identifier="body", mesh=prepare(humans.load(humans.entries[-1])).mesh)
    shape.geodesics()
    return [
        *(given_geodesics(name, shape) for name in GIVEN_GEODESICS),
        biharmonic(shape),
        subspace(shape),
        push(shape),
    ]


def given_geodesics(name: str, shape: Shape) -> dict[str, Any]:
    """A form alone, its geodesics being there."""
    method = variant(name, methods()).create()
    assert isinstance(method, Method)
    seconds = least_seconds(partial(method.canonicalise, shape), REPEATS)
    return row(
        f"{name}, given the geodesics",
        seconds,
        target=f"at most {MOST_SECONDS:g} s",
        met=seconds <= MOST_SECONDS,
        detail=f"{shape.mesh.n_vertices} vertices",
    )


def biharmonic(shape: Shape) -> dict[str, Any]:
    """Distances of all pairs from a hundred eigenfunctions against all of them."""
    laplacian = shape.laplacian()

    def dense() -> FloatArray:
        values, functions = eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass))
        return np.asarray(squareform(pdist(functions[:, 1:] / values[1:])))

    few = partial(distances_under, shape, "biharmonic", 0.05, 100, "default")
    ours, peer = alternately(few, dense, 1)
    expected = dense()
    miss = np.linalg.norm(few() - expected) / np.linalg.norm(expected)
    return row(
        "biharmonic distances of all pairs",
        ours,
        peer="scipy eigh, all eigenfunctions",
        peer_seconds=peer,
        target="at least 5 times faster, within 1 %",
        met=peer >= 5 * ours and miss <= 0.01,
        detail=f"root mean square difference {miss:.1e} of the distances",
    )


def subspace(shape: Shape) -> dict[str, Any]:
    """The whole form against the published update in numpy, from the same samples and functions."""
    method = SubspaceMDS(rtol=0, max_iterations=30)

    def plain() -> FloatArray:
        functions = eigenpairs(shape.laplacian(), max(method.eigenfunctions) + 1)[1][:, 1:]
        samples = farthest_points(shape, 2 * (max(method.eigenfunctions) + 1))
        between = shape.geodesics_from(samples)[:, samples]
        points = shape.mesh.vertices
        for count in method.eigenfunctions:
            chosen = samples[: 2 * (count + 1)]
            targets, seen, start = between[: len(chosen), : len(chosen)], functions[chosen, :count], points[chosen]
            v = len(chosen) * np.eye(len(chosen)) - 1
            project = np.linalg.pinv(seen.T @ v @ seen) @ seen.T
            amounts = np.zeros((count, 3))
            for _ in range(method.max_iterations):
                found = start + seen @ amounts
                ratios = -targets / (squareform(pdist(found)) + np.eye(len(chosen)))
                amounts = project @ ((ratios - np.diag(ratios.sum(axis=1))) @ found - v @ start)
            points = points + functions[:, :count] @ amounts
        return points

    ours, peer = alternately(partial(method.canonicalise, shape), plain, REPEATS)
    found = normalised_stress(method.canonicalise(shape).vertices, shape.geodesics())
    other = normalised_stress(plain(), shape.geodesics())
    return row(
        "subspace-mds with its geodesics",
        ours,
        peer="the published update in numpy",
        peer_seconds=peer,
        target=f"no slower at equal stress, and at most {MOST_SECONDS:g} s",
        met=peer >= ours and ours <= MOST_SECONDS and abs(found - other) <= 0.01 * other,
        detail=f"stress over all pairs {found:.5f} (peer {other:.5f})",
    )


def push(shape: Shape) -> dict[str, Any]:
    """Steps of majorisation against a quasi-Newton method that is given the gradient, to the same energy."""
    springs, points, strength = Springs.of(shape.mesh), farthest_points(shape, 30), 1e-4

    def energy_and_gradient(flat: FloatArray) -> tuple[float, FloatArray]:
        positions = flat.reshape(-1, 3)
        along = springs.incidence @ positions
        lengths = np.linalg.norm(along, axis=1)
        gradient = springs.incidence.T @ (along * (1 - springs.lengths / lengths)[:, None])
        apart = positions[points][:, None] - positions[points]
        away = np.linalg.norm(apart, axis=2) + np.eye(len(points))
        gradient[points] -= strength * (apart / away[..., None]).sum(axis=1)
        return springs.energy(positions, points, strength), gradient.ravel()

    ours = partial(springs.relax, shape.mesh.vertices, points, strength, 150)
    reached = springs.energy(ours(), points, strength)

    class Reached(Exception):
        """Raised as soon as the energy is as low as ours."""

    def stop(intermediate_result: Any) -> None:
        if intermediate_result.fun <= reached:
            raise Reached

    def quasi_newton() -> bool:
        options = {"maxiter": 3000, "maxfun": 10**6}
        start = shape.mesh.vertices.ravel()
        try:
            minimize(energy_and_gradient, start, jac=True, method="L-BFGS-B", callback=stop, options=options)
        except Reached:
            return True
        return False

    seconds, peer = alternately(ours, quasi_newton, REPEATS)
    return row(
        "euclidean-distance, 150 steps with a push",
        seconds,
        peer="scipy L-BFGS-B to the same energy",
        peer_seconds=peer,
        target="no slower",
        met=peer >= seconds,
        detail=f"energy {reached:.5f}, {'reached' if quasi_newton() else 'not reached'} by the peer",
    )

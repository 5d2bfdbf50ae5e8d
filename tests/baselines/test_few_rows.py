"""Scaling of a few rows of distances, beside released code, published formulas, and scaling of all pairs."""

import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.sampling import farthest_points
from baselines._kernels.smacof import smacof
from baselines.accelerated_mds import AcceleratedMDS
from baselines.classic_mds import ClassicMDS
from baselines.fast_classical_scaling import FastClassicalScaling
from baselines.fast_mds import FastMDS
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.nystrom_mds import NystromMDS
from baselines.subspace_mds import SubspaceMDS
from benchmark.api.contracts import Shape
from benchmark.datasets.official.tosca import tosca
from benchmark.geometry.preparation import prepare
from tests.baselines.embedding import (
    PointShape,
    RowsOnly,
    brute_force_stress,
    limbed,
    points_on_ellipsoid,
    sphere,
    spread,
)


def prepared(data_root, step: slice | str) -> list[Shape]:
    """Prepared shapes of TOSCA: every few, or one by name."""
    data = tosca(data_root)
    entries = data.entries[step] if isinstance(step, slice) else [e for e in data.entries if e.identifier == step]
    return [Shape(identifier=entry.identifier, mesh=prepare(data.load(entry)).mesh) for entry in entries]


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [
        (AcceleratedMDS(variant="interpolated", samples=120), 1e-5),
        (AcceleratedMDS(variant="samples", samples=120), 1e-5),
        (FastClassicalScaling(samples=120, fidelity=1e12), 1e-4),
    ],
)
def test_all_vertices_as_samples_give_classic_scaling(method, tolerance):
    shape = limbed(120)
    classic = ClassicMDS().canonicalise(shape).vertices
    np.testing.assert_allclose(method.canonicalise(shape).vertices, classic, atol=tolerance)


@pytest.mark.data
def test_the_stress_of_accelerated_scaling_is_within_five_per_cent_of_classic_scaling(data_root):
    (shape,) = prepared(data_root, "michael3")
    form = AcceleratedMDS(variant="interpolated").canonicalise(shape)
    classic = ClassicMDS().canonicalise(shape).notes["stress"]
    assert brute_force_stress(form.vertices, shape.geodesics()) < 1.05 * classic


def require_released(shape: Shape, samples: int, fidelity: float) -> None:
    """Compare with the steps of the released code of FMDS, with dense matrices of all vertices."""
    laplacian = shape.laplacian()
    n, stiffness = len(laplacian.mass), laplacian.stiffness.toarray()
    areas = laplacian.mass * n / laplacian.mass.sum()
    chosen = farthest_points(shape, samples)
    fit = np.zeros((n, n))
    fit[chosen, chosen] = fidelity
    continuation = np.linalg.solve(stiffness.T @ np.diag(areas**-2.0) @ stiffness + fit, fit[:, chosen])
    product = continuation @ shape.geodesics()[chosen] ** 2
    centre = np.eye(n) - 1 / n
    values, vectors = eigh(-0.25 * centre @ (product + product.T) @ centre, subset_by_index=(n - 3, n - 1))
    expected = spread(vectors * np.sqrt(np.maximum(values, 0)))
    form = FastClassicalScaling(samples=samples, fidelity=fidelity).canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-6 * expected.max())


@pytest.mark.parametrize(("samples", "fidelity"), [(20, 50.0), (30, 1e8), (12, 0.1)])
def test_fast_classical_scaling_is_that_of_the_released_code(samples, fidelity):
    require_released(limbed(250), samples, fidelity)


@pytest.mark.data
def test_forms_of_animals_and_people_are_those_of_the_released_code(data_root):
    for shape in prepared(data_root, slice(None, None, 8)):
        require_released(shape, 20, 50.0)


def test_nystrom_is_the_published_formula(samples=60, rank=25):
    shape = limbed(250)
    chosen = farthest_points(shape, samples)
    rows = shape.geodesics_from(chosen) ** 2
    between = (rows[:, chosen] + rows[:, chosen].T) / 2
    left, sizes, right = np.linalg.svd(between)
    inverse = right[:rank].T / sizes[:rank] @ left[:, :rank].T
    squared = rows.T @ inverse @ rows
    centre = np.eye(250) - 1 / 250
    values, vectors = np.linalg.eigh(-0.5 * centre @ (squared + squared.T) / 2 @ centre)
    expected = spread(vectors[:, -3:] * np.sqrt(np.maximum(values[-3:], 0)))
    form = NystromMDS(samples=samples, rank=rank).canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-6 * expected.max())
    assert (form.notes["samples"], form.notes["rank"]) == (samples, rank)


class FewRows(RowsOnly, PointShape):
    """Points that have no all pairs of distances to give."""


def test_points_in_space_are_recovered_from_few_rows():
    shape = FewRows(points_on_ellipsoid())
    form = FastMDS().canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(shape.mesh.vertices), atol=1e-9)
    assert len(shape.asked) == len(set(shape.asked)) == form.notes["rows"] <= 18
    assert form.notes["stress_of_rows"] == pytest.approx(0, abs=1e-12)
    # Squared Euclidean distances in space have rank five, so that five eigenvalues say all.
    points = sphere(200).vertices * [3.0, 2.0, 1.0]
    form = NystromMDS(samples=12, rank=5).canonicalise(PointShape(points))
    np.testing.assert_allclose(spread(form.vertices), spread(points), atol=1e-8)


def published(shape: Shape, eigenfunctions: int, samples: int, iterations: int) -> np.ndarray:
    """One level of subspace MDS: pseudo-inverse of the projected V, and B by its definition."""
    laplacian = shape.laplacian()
    functions = eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass))[1][:, 1 : eigenfunctions + 1]
    chosen = farthest_points(shape, samples)
    targets = shape.geodesics()[np.ix_(chosen, chosen)]
    start, at_samples = shape.mesh.vertices[chosen], functions[chosen]
    v = len(chosen) * np.eye(len(chosen)) - 1
    points = start
    for _ in range(iterations):
        ratios = -targets / (spread(points) + np.eye(len(chosen)))
        b = ratios - np.diag(ratios.sum(axis=1))
        amounts = np.linalg.pinv(at_samples.T @ v @ at_samples) @ at_samples.T @ (b @ points - v @ start)
        points = start + at_samples @ amounts
    return shape.mesh.vertices + functions @ amounts


@pytest.mark.parametrize(("eigenfunctions", "iterations"), [(20, 1), (40, 7)])
def test_a_level_of_subspace_scaling_agrees_with_the_published_update(eigenfunctions, iterations):
    shape = limbed(250)
    method = SubspaceMDS(eigenfunctions=(eigenfunctions,), max_iterations=iterations, rtol=0)
    form = method.canonicalise(shape)
    assert form.notes["samples"] == 2 * (eigenfunctions + 1)
    expected = published(shape, eigenfunctions, form.notes["samples"], iterations)
    np.testing.assert_allclose(spread(form.vertices), spread(expected), atol=1e-6)


def test_all_functions_and_samples_give_least_squares_scaling():
    shape = limbed(120)
    plain = smacof(shape.geodesics(), shape.mesh.vertices, max_iterations=9, rtol=0)
    form = SubspaceMDS(eigenfunctions=(119,), max_iterations=9, rtol=0).canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(plain.points), atol=1e-5)


def test_subspace_scaling_is_as_good_as_plain_majorisation_from_a_part_of_the_rows():
    shape = limbed(1000)
    plain = smacof(shape.geodesics(), shape.mesh.vertices)
    form = SubspaceMDS().canonicalise(RowsOnly(identifier="limbed", mesh=shape.mesh))
    assert form.notes["samples"] < 0.5 * shape.mesh.n_vertices
    # The samples weigh the surface evenly, and the vertices of this one are dense at its middle.
    assert brute_force_stress(form.vertices, shape.geodesics()) < 1.15 * plain.stress[-1]


@pytest.mark.data
def test_where_plain_majorisation_stops_early_few_functions_find_a_far_better_pose(data_root):
    (shape,) = prepared(data_root, "michael3")
    form = SubspaceMDS(eigenfunctions=(50, 100)).canonicalise(shape)
    plain = smacof(shape.geodesics(), shape.mesh.vertices).stress[-1]
    converged = LeastSquaresMDS(max_iterations=1000, rtol=1e-5).canonicalise(shape).notes["stress"]
    stress = brute_force_stress(form.vertices, shape.geodesics())
    assert stress < 0.5 * plain
    assert stress < 1.25 * converged  # quasi-Newton steps over all vertices end lower still

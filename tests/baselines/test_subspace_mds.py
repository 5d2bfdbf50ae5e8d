import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.sampling import farthest_points
from baselines._kernels.smacof import smacof
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.subspace_mds import SubspaceMDS
from benchmark.api.contracts import Shape
from benchmark.datasets.official.tosca import tosca
from benchmark.geometry.preparation import prepare
from tests.baselines.embedding import RowsOnly, brute_force_stress, limbed, spread


def published(shape: Shape, eigenfunctions: int, samples: int, iterations: int) -> np.ndarray:
    """One level by the published update: pseudo-inverse of the projected V, and B by its definition."""
    laplacian = shape.laplacian()
    functions = eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass))[1][:, 1 : eigenfunctions + 1]
    chosen = farthest_points(shape, samples)
    targets = shape.geodesics()[np.ix_(chosen, chosen)]
    start, seen = shape.mesh.vertices[chosen], functions[chosen]
    v = len(chosen) * np.eye(len(chosen)) - 1
    found = start
    for _ in range(iterations):
        ratios = -targets / (spread(found) + np.eye(len(chosen)))
        b = ratios - np.diag(ratios.sum(axis=1))
        amounts = np.linalg.pinv(seen.T @ v @ seen) @ seen.T @ (b @ found - v @ start)
        found = start + seen @ amounts
    return shape.mesh.vertices + functions @ amounts


@pytest.mark.parametrize(("eigenfunctions", "iterations"), [(20, 1), (40, 7)])
def test_a_level_agrees_with_the_published_update(eigenfunctions, iterations):
    shape = limbed(250)
    method = SubspaceMDS(eigenfunctions=(eigenfunctions,), max_iterations=iterations, rtol=0)
    form = method.canonicalise(shape)
    samples = form.notes["samples"]
    assert samples == 2 * (eigenfunctions + 1)
    expected = published(shape, eigenfunctions, samples, iterations)
    np.testing.assert_allclose(spread(form.vertices), spread(expected), atol=1e-6)


def test_all_functions_and_samples_give_least_squares_scaling():
    shape = limbed(120)
    method = SubspaceMDS(eigenfunctions=(119,), max_iterations=9, rtol=0)
    plain = smacof(shape.geodesics(), shape.mesh.vertices, max_iterations=9, rtol=0)
    form = method.canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(plain.points), atol=1e-5)


def test_it_is_as_good_as_plain_majorisation_from_a_part_of_the_rows():
    shape = limbed(1000)
    plain = smacof(shape.geodesics(), shape.mesh.vertices)
    form = SubspaceMDS().canonicalise(RowsOnly(identifier="limbed", mesh=shape.mesh))
    assert form.notes["samples"] < 0.5 * shape.mesh.n_vertices
    # The samples weigh the surface evenly, and the vertices of this one are dense at its middle.
    assert brute_force_stress(form.vertices, shape.geodesics()) < 1.15 * plain.stress[-1]


@pytest.mark.data
def test_where_plain_majorisation_stops_early_few_functions_find_a_far_better_pose(data_root):
    dataset = tosca(data_root)
    entry = next(entry for entry in dataset.entries if entry.identifier == "michael3")
    shape = Shape(identifier="michael3", mesh=prepare(dataset.load(entry)).mesh)
    form = SubspaceMDS(eigenfunctions=(50, 100)).canonicalise(shape)
    plain = smacof(shape.geodesics(), shape.mesh.vertices).stress[-1]
    converged = LeastSquaresMDS(max_iterations=1000, rtol=1e-5).canonicalise(shape).notes["stress"]
    found = brute_force_stress(form.vertices, shape.geodesics())
    assert found < 0.5 * plain
    assert found < 1.25 * converged  # quasi-Newton steps over all vertices end lower still

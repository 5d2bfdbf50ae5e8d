"""Scaling of a few rows of distances, beside released code, published formulas, and scaling of all
pairs.
"""

import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.few_rows import farthest_points
from baselines.accelerated_mds import AcceleratedMDS
from baselines.fast_classical_scaling import FastClassicalScaling
from baselines.fast_mds import FastMDS
from tests.baselines.embedding import PointShape, RowsOnly, limbed, points_on_ellipsoid, spread


@pytest.mark.parametrize(("samples", "fidelity"), [(20, 50.0), (30, 1e8), (12, 0.1)])
def test_fast_classical_scaling_is_that_of_the_released_code(samples, fidelity):
    """Its steps with dense matrices of all vertices."""
    shape = limbed(250)
    laplacian = shape.laplacian()
    n, stiffness = len(laplacian.mass), laplacian.stiffness.toarray()
    areas = laplacian.mass * n / laplacian.mass.sum()
    chosen = farthest_points(shape, samples)
    fit = np.zeros((n, n))
    fit[chosen, chosen] = fidelity
    continuation = np.linalg.solve(
        stiffness.T @ np.diag(areas**-2.0) @ stiffness + fit, fit[:, chosen]
    )
    product = continuation @ shape.geodesics()[chosen] ** 2
    centre = np.eye(n) - 1 / n
    values, vectors = eigh(
        -0.25 * centre @ (product + product.T) @ centre, subset_by_index=(n - 3, n - 1)
    )
    expected = spread(vectors * np.sqrt(np.maximum(values, 0)))
    method, alone = (
        FastClassicalScaling(samples=samples, fidelity=fidelity),
        RowsOnly(identifier="x", mesh=shape.mesh),
    )
    form = method.canonicalise(alone)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-6 * expected.max())


@pytest.mark.parametrize("samples", [5, 25])
def test_accelerated_mds_is_that_of_its_definition(samples):
    """Smoothest functions with given values at the samples, by dense matrices of all vertices."""
    shape = limbed(250)
    chosen, stiffness, mass = (
        farthest_points(shape, samples),
        shape.laplacian().stiffness.toarray(),
        shape.laplacian().mass,
    )
    smoothness = stiffness @ np.diag(1 / mass) @ stiffness
    others = np.setdiff1d(np.arange(len(mass)), chosen)
    interpolation = np.eye(len(mass))[:, chosen]
    interpolation[others] = -np.linalg.solve(
        smoothness[np.ix_(others, others)], smoothness[np.ix_(others, chosen)]
    )
    centre = np.eye(len(mass)) - 1 / len(mass)
    squares = interpolation @ shape.geodesics()[np.ix_(chosen, chosen)] ** 2 @ interpolation.T
    values, vectors = eigh(
        -0.5 * centre @ squares @ centre, subset_by_index=(len(mass) - 3, len(mass) - 1)
    )
    expected = spread(vectors * np.sqrt(np.maximum(values, 0)))
    form = AcceleratedMDS(samples=samples).canonicalise(RowsOnly(identifier="x", mesh=shape.mesh))
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-5 * expected.max())


class FewRows(RowsOnly, PointShape):
    """Points that have no all pairs of distances to give."""


def test_points_in_space_are_recovered_from_few_rows():
    shape = FewRows(points_on_ellipsoid())
    form = FastMDS().canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(shape.mesh.vertices), atol=1e-9)
    assert len(shape.asked) == len(set(shape.asked)) == form.notes["rows"] <= 18
    assert form.notes["stress_of_rows"] == pytest.approx(0, abs=1e-12)

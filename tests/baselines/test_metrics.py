"""Scaling of diffusion, commute-time and biharmonic distances."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from baselines._kernels.spectral import distances_under
from baselines.classic_mds import ClassicMDS
from baselines.least_squares_mds import LeastSquaresMDS
from benchmark.api.contracts import Mesh, Shape, UnsupportedShape
from benchmark.errors import ConfigurationError
from tests.baselines.deformable import shape_of
from tests.baselines.embedding import limbed

METRICS = ("diffusion", "commute-time", "biharmonic")


def by_definition(shape: Shape, metric: str, time: float) -> np.ndarray:
    """Squared distances without eigenfunctions: heat kernel, Green's function, and the product of two of those."""
    laplacian = shape.laplacian()
    stiffness, mass = laplacian.stiffness.toarray(), laplacian.mass
    area, n = mass.sum(), len(mass)
    if metric == "diffusion":
        heat = expm(-time * area * stiffness / mass[:, None]) / mass
        kernel = area**2 * (heat * mass) @ heat.T
    else:
        mean_free = np.eye(n) - np.outer(np.ones(n), mass) / area
        green = mean_free @ np.linalg.pinv(stiffness) @ mean_free.T
        kernel = area * green if metric == "commute-time" else green @ (mass[:, None] * green)
    diagonal = np.diag(kernel)
    return diagonal[:, None] + diagonal - 2 * kernel


@pytest.mark.parametrize("metric", METRICS)
def test_with_all_eigenfunctions_the_distances_are_those_of_the_definition(metric):
    shape = limbed(120)
    shape.mesh = shape.mesh.with_vertices(1.7 * shape.mesh.vertices)
    distances = distances_under(shape, metric, 0.03, 119, "default")
    expected = by_definition(shape, metric, 0.03)
    np.testing.assert_allclose(distances**2, expected, atol=1e-9 * expected.max())


def test_parts_that_hang_together_by_nothing_are_refused():
    # Two tetrahedra, and a triangle without area from one to the other.
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    mesh = Mesh(
        np.concatenate([corners, corners + np.array([5, 0, 0])]), np.concatenate([sides, sides + 4, [[0, 1, 4]]])
    )
    with pytest.raises(UnsupportedShape, match="triangles without area"):
        ClassicMDS(metric="biharmonic").canonicalise(shape_of(mesh))


def test_an_unknown_metric_and_a_time_that_does_not_pass_are_refused():
    with pytest.raises(ConfigurationError, match="did you mean biharmonic"):
        ClassicMDS(metric="biharmonc")  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="time of least-squares-mds"):
        LeastSquaresMDS(metric="diffusion", time=0)

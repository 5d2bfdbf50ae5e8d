import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import eigsh
from scipy.spatial.distance import cdist

from baselines._kernels.eigen import centred_eigenpairs
from baselines._kernels.orientation import canonical_signs, vertex_areas
from baselines.classic_mds import ClassicMDS, classic_scaling
from tests.baselines.embedding import (
    PointShape,
    points_on_ellipsoid,
    spread,
)

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize("n", [4, 64, 301])
def test_points_in_space_are_recovered(n):
    points = np.random.default_rng(n).standard_normal((n, 3)) * [3, 2, 1]
    found, ratios = classic_scaling(cdist(points, points))
    np.testing.assert_allclose(spread(found), spread(points), atol=1e-8)
    assert ratios[3] == pytest.approx(0, abs=1e-9)


def test_a_euclidean_shape_comes_back_in_its_canonical_frame():
    points = points_on_ellipsoid()
    shape = PointShape(points)
    form = ClassicMDS().canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(points), atol=1e-8)
    assert form.notes["stress"] == pytest.approx(0, abs=1e-12)
    assert (canonical_signs(form.vertices, vertex_areas(shape.mesh), shape.mesh.vertices)[:2] == 1).all()
    assert form.notes["handedness"] >= 0
    mirrored = ClassicMDS().canonicalise(PointShape(points * [1, 1, -1]))
    np.testing.assert_allclose(mirrored.vertices, form.vertices, atol=1e-8)


def test_eigenpairs_agree_with_double_centring_and_arpack(n=401):
    points = np.random.default_rng(0).standard_normal((n, 6)) * [3, 2, 1.5, 0.8, 0.5, 0.2]
    distances = cdist(points, points) ** 0.8
    values, vectors = centred_eigenpairs(distances, 4, accurate=3)
    squared = distances**2
    means = squared.mean(axis=0)
    centred = -0.5 * (squared - means - means[:, None] + means.mean())
    expected = np.sort(eigsh(centred, k=4, which="LA", return_eigenvectors=False))[::-1]
    np.testing.assert_allclose(values, expected, rtol=1e-10)
    residuals = np.linalg.norm(centred @ vectors - vectors * values, axis=0)[:3]
    assert (residuals <= 2e-9 * values[0]).all()
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(4), atol=1e-12)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(4, 140))
def test_eigenvalues_agree_on_any_symmetric_matrix(seed, n):
    distances = np.random.default_rng(seed).random((n, n))
    distances = distances + distances.T
    np.fill_diagonal(distances, 0)
    squared = distances**2
    means = squared.mean(axis=0)
    expected = np.linalg.eigvalsh(-0.5 * (squared - means - means[:, None] + means.mean()))[:-4:-1]
    np.testing.assert_allclose(centred_eigenpairs(distances, 3, accurate=3)[0], expected, rtol=1e-9, atol=1e-12)


def test_negative_eigenvalues_count_as_zero():
    # Four corners of a square with shortest paths along its sides: eigenvalues 2, 2, 0 and -1 by hand.
    ring = np.array([[0, 1, 2, 1], [1, 0, 1, 2], [2, 1, 0, 1], [1, 2, 1, 0]], dtype=float)
    points, ratios = classic_scaling(ring)
    np.testing.assert_allclose(ratios, [1, 1, 0, -0.5], atol=1e-12)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-7)
    np.testing.assert_allclose(spread(points)[0], [0, np.sqrt(2), 2, np.sqrt(2)], atol=1e-7)

import numpy as np
import pytest

from baselines._kernels.orientation import vertex_areas
from baselines.pca import PCA
from benchmark.api.contracts import Shape
from tests.baselines.embedding import limbed, moved, sphere


def test_an_ellipsoid_comes_to_lie_along_its_axes():
    mesh = sphere(600)
    ellipsoid = Shape(identifier="ellipsoid", mesh=mesh.with_vertices(mesh.vertices * [1, 5, 3]))
    form = PCA().canonicalise(moved(ellipsoid)).vertices
    np.testing.assert_allclose(np.ptp(form, axis=0), [10, 6, 2], rtol=0.02)


def test_the_form_is_a_rotation_with_falling_uncorrelated_variances():
    shape = limbed()
    form = PCA().canonicalise(shape)
    areas = vertex_areas(shape.mesh)
    covariance = (form.vertices * areas[:, None]).T @ form.vertices / areas.sum()
    np.testing.assert_allclose(covariance, np.diag(np.diag(covariance)), atol=1e-12)
    assert (np.diff(np.diag(covariance)) < 0).all()
    assert form.notes["variance_ratio_2"] == pytest.approx(covariance[1, 1] / covariance[0, 0])
    centred = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    turn = np.linalg.lstsq(centred, form.vertices - form.vertices.mean(axis=0), rcond=None)[0]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-10)
    assert np.linalg.det(turn) == pytest.approx(1)

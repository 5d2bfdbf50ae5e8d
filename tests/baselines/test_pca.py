import numpy as np
import pytest

from baselines._kernels.orientation import vertex_areas
from baselines.pca import PCA
from tests.baselines.embedding import limbed


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

import numpy as np
import pytest

from baselines._kernels.orientation import vertex_areas
from baselines.pca import PCA
from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.geometry.mesh import Mesh
from tests.baselines.embedding import limbed, moved, relabelled, sphere


def test_an_ellipsoid_comes_to_lie_along_its_axes():
    mesh = sphere(600)
    ellipsoid = Shape(identifier="ellipsoid", mesh=mesh.with_vertices(mesh.vertices * [1, 5, 3]))
    form = PCA().canonicalise(moved(ellipsoid)).vertices
    np.testing.assert_allclose(np.ptp(form, axis=0), [10, 6, 2], rtol=0.02)


def test_the_frame_is_independent_of_motion_and_numbering():
    shape = limbed()
    form = PCA().canonicalise(shape).vertices
    np.testing.assert_allclose(PCA().canonicalise(moved(shape)).vertices, form, atol=1e-10)
    other, order = relabelled(shape)
    np.testing.assert_allclose(PCA().canonicalise(other).vertices, form[order], atol=1e-10)


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


def test_a_triangle_is_refused():
    with pytest.raises(UnsupportedShape, match="3 vertices"):
        PCA().canonicalise(Shape(identifier="triangle", mesh=Mesh(np.eye(3), np.array([[0, 1, 2]]))))

"""Forms are turned so that they can be compared by eye, and drawn on nothing."""

import numpy as np
import pytest

from benchmark.geometry.mesh import Mesh
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import centred, reach, turn_onto, upright
from tests.toy import rod


def turn(seed, mirrored):
    made = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return made * [1, 1, -1] if (np.linalg.det(made) < 0) != mirrored else made


@pytest.fixture(scope="module")
def shape():
    """A bent rod, thicker at one end, so that nothing of it is symmetric."""
    mesh = rod(0.12, 1.2, rings=14, sides=8)
    return mesh.with_vertices(mesh.vertices + np.outer(mesh.vertices[:, 0] ** 2, [0, 0.4, 0]))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_turned_or_mirrored_copy_is_brought_back(shape, mirrored):
    found, left = turn_onto(shape.vertices @ turn(1, mirrored), shape.vertices)
    assert left < 1e-9
    np.testing.assert_allclose(turn(1, mirrored) @ found, np.eye(3), atol=1e-9)


def test_the_shape_itself_stays_as_its_camera_sees_it_whatever_the_model(shape):
    form = shape.with_vertices(shape.vertices @ turn(2, False) * 3)
    shown = upright(form, shape, shape.vertices, model=shape.vertices @ turn(3, False))
    np.testing.assert_allclose(centred(shown), centred(shape.vertices * 3), atol=1e-8)


def test_forms_of_other_poses_are_turned_like_the_first_one(shape):
    """The second form is the first one, in another place, of a shape that lies on its back."""
    model = centred(shape.vertices * [1, 2, 1])
    form = shape.with_vertices(model @ turn(4, True))
    lying = shape.vertices[:, [0, 2, 1]] * [1, -1, 1.3]
    np.testing.assert_allclose(upright(form, shape, lying, model), model, atol=1e-6)


def test_a_form_with_triangles_of_its_own_is_shown_as_it_is(shape):
    form = Mesh(shape.vertices[:9], [[0, 1, 2], [2, 3, 4]])
    assert (upright(form, shape, shape.vertices, None) == form.vertices).all()


def test_a_few_far_points_do_not_make_a_speck_of_a_form():
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    points[0] = 100
    assert reach(centred(points)) < 1.1


def test_the_middle_of_a_body_is_told_from_its_tips_in_any_pose():
    straight, bent = (outwardness(rod(0.1, bend, rings=20, sides=8)) for bend in (0.0, 1.5))
    along = rod(0.1, 0.0, rings=20, sides=8).vertices[:, 0]
    assert abs(along[straight.argmin()] - 0.5) < 0.1
    assert abs(along[straight.argmax()] - 0.5) > 0.45
    assert (straight.min(), straight.max()) == (0, 1)
    assert np.corrcoef(straight, bent)[0, 1] > 0.9


def test_a_picture_is_transparent_beside_its_surface_and_hides_what_lies_behind():
    near, far = [[-0.5, -0.5, 1], [0.5, -0.5, 1], [0, 0.5, 1]], [[-0.9, -0.9, 0], [0.9, -0.9, 0], [0, 0.9, 0]]
    picture = np.asarray(
        painted(
            np.array(near + far), np.array([[0, 1, 2], [3, 4, 5]], np.int32), np.array([0.0] * 3 + [1.0] * 3), 64, 1.0
        )
    )
    assert picture.shape == (64, 64, 4)
    assert picture[2, 2, 3] == 0
    centre, edge = picture[34, 32], picture[60, 32]
    assert centre[3] == edge[3] == 255
    assert centre[2] > centre[0]  # blue is the middle of a body, and here it is in front
    assert edge[0] > edge[2]


def test_what_is_thinner_than_a_pixel_does_not_vanish():
    thin = np.array([[-0.8, 0.0, 0], [0.8, 1e-4, 0], [0.8, 0, 0]])
    picture = np.asarray(painted(thin, np.array([[0, 1, 2]], np.int32), None, 64, 1.0))
    assert (picture[30:34, 10:54, 3].max(axis=0) > 50).all()

"""Forms are turned so that they can be compared by eye, and drawn on nothing."""

import numpy as np
import pytest

from benchmark.report.pictures.posing import centred, turn_onto, upright
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

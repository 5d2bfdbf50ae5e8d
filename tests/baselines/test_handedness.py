"""Handedness: by hand, of mirror images, turned and jittered surfaces, other triangulations and open views."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines._kernels.handedness import NEGLIGIBLE, handedness, right_handed
from baselines._kernels.orientation import vertex_areas
from benchmark.api.contracts import Shape
from benchmark.plugins.conformance.shapes import figure, view
from benchmark.plugins.registry import methods, variant

MIRROR = np.array([1.0, 1.0, -1.0])
TURNED = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()

OPEN = (
    "classic-mds",
    "classic-mds[metric=biharmonic]",
    "fast-mds",
    "nystrom-mds",
    "fast-classical-scaling",
    "accelerated-mds",
    "scikit-learn-classical-mds",
    "scikit-learn-isomap",
    "gps",
)

#: Four tips of a propeller: half a turn about any axis leaves it, a mirror does not.
PROPELLER = np.array([[3.0, 2, 1], [3, -2, -1], [-3, 2, -1], [-3, -2, 1]])


def alignment(points, others, weights):
    """Distance of points from others, turned onto them, over the radius of gyration; whether a mirror is nearer."""
    points, others = points - weights @ points, others - weights @ others
    left, _, right = np.linalg.svd((points * weights[:, None]).T @ others)
    mirrored = np.linalg.det(left @ right) < 0
    if mirrored:
        left[:, 2] *= -1
    rest = weights @ ((points @ left @ right - others) ** 2).sum(axis=1)
    return np.sqrt(rest / (weights @ (others**2).sum(axis=1))), mirrored


def of(mesh):
    return handedness(mesh.vertices, vertex_areas(mesh))


def test_by_hand():
    assert handedness(PROPELLER, np.ones(4)) == pytest.approx(1)
    assert handedness(PROPELLER * MIRROR, np.ones(4)) == pytest.approx(-1)
    # Tips with twins across the plane z = 0 of half its weight: (1 - 1/2) / (1 + 1/2).
    both = np.vstack([PROPELLER, PROPELLER * MIRROR])
    assert handedness(both, np.repeat([1.0, 0.5], 4)) == pytest.approx(1 / 3)


@pytest.mark.parametrize("axis", range(3))
def test_a_mirror_changes_the_sign_and_nothing_else(axis):
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    for mesh in (figure(), view().mesh):
        found = of(mesh)
        assert abs(found) > 0.02
        assert of(mesh.with_vertices(mesh.vertices * mirror)) == pytest.approx(-found, rel=1e-9)


def test_the_side_is_the_same_from_either_and_what_is_even_stays_as_it_is():
    weights = np.array([1.0, 2, 1, 1])
    assert handedness(PROPELLER, weights) > 0.5
    np.testing.assert_array_equal(right_handed(PROPELLER, weights), PROPELLER)
    np.testing.assert_array_equal(right_handed(PROPELLER * MIRROR, weights), PROPELLER)
    even = np.array([[3.0, 0, 1], [-2, 0, 1], [0, 2, -1], [0, -2, -1]])  # mirrored onto itself by y
    noise = 1e-9 * np.random.default_rng(0).standard_normal(even.shape)
    for sign in (1, -1):
        assert abs(handedness(even + sign * noise, np.ones(4))) <= NEGLIGIBLE
        np.testing.assert_array_equal(right_handed(even + sign * noise, np.ones(4)), even + sign * noise)


@pytest.mark.parametrize("name", OPEN)
def test_methods_that_see_distances_alone_settle_the_side(name):
    method = variant(name, methods()).create()
    mesh = figure()
    form = method.canonicalise(Shape(identifier="figure", mesh=mesh))
    weights = vertex_areas(mesh)
    assert handedness(form.vertices, weights) > 0.02
    assert "metric" in name or form.notes["handedness"] == pytest.approx(handedness(form.vertices, weights), abs=1e-3)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    for vertices in (mesh.vertices * MIRROR, (mesh.vertices + noise) @ TURNED.T):
        other = method.canonicalise(Shape(identifier="figure", mesh=mesh.with_vertices(vertices)))
        distance, mirrored = alignment(form.vertices, other.vertices, weights / weights.sum())
        assert not mirrored
        assert distance < 0.01

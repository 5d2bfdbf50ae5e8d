from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.geometry.mesh import Mesh
from retrieval.pose import to_unit_sphere
from retrieval.views import CUBE_ROTATIONS, render, view_sphere
from tests.retrieval.figures import figure, turned

pytestmark = pytest.mark.kernels

SPHERE = view_sphere(2)
DIRECTIONS, CAMERAS, ORBITS, VIEW_PERMUTATIONS = SPHERE.directions, SPHERE.cameras, SPHERE.orbits, SPHERE.permutations


def test_directions_are_the_twice_subdivided_octahedron() -> None:
    assert DIRECTIONS.shape == (66, 3)
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1)
    sphere = trimesh.convex.convex_hull(DIRECTIONS)
    assert (len(sphere.vertices), len(sphere.faces)) == (66, 128)
    # One representative of each orbit: corner, edge midpoint, and the two kinds of second midpoints.
    representatives = np.array([np.sort(np.abs(DIRECTIONS[orbit == ORBITS][0])) for orbit in range(4)])
    expected = [[0, 0, 1], [0, 0.3827, 0.9239], [0, 0.7071, 0.7071], [0.4082, 0.4082, 0.8165]]
    np.testing.assert_allclose(representatives[np.lexsort(representatives.T[::-1].round(3))], expected, atol=1e-4)
    assert sorted(np.bincount(ORBITS)) == [6, 12, 24, 24]


def test_permutations_form_the_rotation_group_of_the_cube() -> None:
    table = {tuple(p) for p in VIEW_PERMUTATIONS}
    assert len(table) == 24
    np.testing.assert_allclose(np.linalg.det(CUBE_ROTATIONS), 1)
    for p in VIEW_PERMUTATIONS:
        assert sorted(p) == list(range(66))
        assert {tuple(p[q]) for q in VIEW_PERMUTATIONS} == table
        assert (ORBITS[p] == ORBITS).all()
    assert len({(i, j) for p in VIEW_PERMUTATIONS for i, j in enumerate(p)}) == 1332
    for rotation, p in zip(CUBE_ROTATIONS, VIEW_PERMUTATIONS, strict=True):
        np.testing.assert_allclose(DIRECTIONS @ rotation.T, DIRECTIONS[p], atol=1e-12)


def test_cameras_look_at_the_origin_with_the_rule_for_up() -> None:
    np.testing.assert_allclose(CAMERAS @ CAMERAS.transpose(0, 2, 1), np.tile(np.eye(3), (66, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(CAMERAS), 1)
    along_y = np.abs(DIRECTIONS[:, 1]) > 0.999
    assert along_y.sum() == 2
    np.testing.assert_allclose(CAMERAS[along_y, 1], [[0, 0, 1]] * 2)
    assert (CAMERAS[~along_y, 1, 1] > 0).all()


@pytest.mark.parametrize("triangles", ["small", "large"])
def test_a_view_that_is_drawn_with_its_opposite_is_the_same_as_drawn_alone(triangles: str) -> None:
    corners = np.random.default_rng(0).normal(size=(36, 3))
    mesh = to_unit_sphere(figure() if triangles == "small" else Mesh(corners, np.arange(36).reshape(12, 3)))
    np.testing.assert_array_equal(DIRECTIONS[SPHERE.opposite], -DIRECTIONS)
    together = render(mesh, 96, SPHERE)
    for view in range(66):
        np.testing.assert_array_equal(together[view], render(mesh, 96, SPHERE, slice(view, view + 1))[0])


def test_depth_of_a_small_sphere_off_centre() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.25)
    mesh = Mesh(ball.vertices + np.array([0.5, 0, 0]), ball.faces)
    front, back = render(mesh, 256, SPHERE)[[0, 1]]
    # Seen along +x the ball is nearest at x = 0.75, seen along -x at x = 0.25.
    assert front[128, 128] == pytest.approx((1 - 0.75) / 2, abs=1e-3)
    assert back[128, 128] == pytest.approx((1 + 0.25) / 2, abs=1e-3)
    along_z = render(mesh, 256, SPHERE, slice(4, 5))[0]
    rows, columns = np.nonzero(along_z < 1)
    # From +z with y upwards, +x lies to the right; pixel 192 is x = 0.5.
    assert columns.mean() + 0.5 == pytest.approx(192, abs=0.2)
    assert rows.mean() + 0.5 == pytest.approx(128, abs=0.2)
    assert len(rows) == pytest.approx(np.pi * 32**2, rel=0.01)


def test_a_turned_form_shows_the_permuted_views() -> None:
    mesh = to_unit_sphere(figure())
    areas = (render(mesh, 128, SPHERE) < 1).sum(axis=(1, 2))
    for rotation, p in zip(CUBE_ROTATIONS, VIEW_PERMUTATIONS, strict=True):
        after = (render(turned(mesh, rotation), 128, SPHERE) < 1).sum(axis=(1, 2))
        np.testing.assert_allclose(after[p], areas, rtol=0.03)

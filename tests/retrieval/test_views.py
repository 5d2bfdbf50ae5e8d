from __future__ import annotations

import numpy as np
import pytest

from benchmark.geometry.mesh import Mesh
from retrieval.pose import to_unit_sphere
from retrieval.views import CUBE_ROTATIONS, render, view_sphere
from tests.retrieval.figures import figure

pytestmark = pytest.mark.kernels

SPHERE = view_sphere(2)
DIRECTIONS, CAMERAS, ORBITS, VIEW_PERMUTATIONS = SPHERE.directions, SPHERE.cameras, SPHERE.orbits, SPHERE.permutations


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


@pytest.mark.parametrize("triangles", ["small", "large"])
def test_a_view_that_is_drawn_with_its_opposite_is_the_same_as_drawn_alone(triangles: str) -> None:
    corners = np.random.default_rng(0).normal(size=(36, 3))
    mesh = to_unit_sphere(figure() if triangles == "small" else Mesh(corners, np.arange(36).reshape(12, 3)))
    np.testing.assert_array_equal(DIRECTIONS[SPHERE.opposite], -DIRECTIONS)
    together = render(mesh, 96, SPHERE)
    for view in range(66):
        np.testing.assert_array_equal(together[view], render(mesh, 96, SPHERE, slice(view, view + 1))[0])

"""The arrays of the windows hold every window, whatever the degrees of the vertices and the budget."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmark.geometry import geodesic_graph as module
from benchmark.geometry.geodesic_graph import WINDOWS, geodesic_graph
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.shortest_paths import shortest_paths
from tests.geometry.surfaces import capped_cylinder, relabelled

pytestmark = pytest.mark.kernels


@pytest.fixture
def interpreted(monkeypatch):
    """Run the kernel as Python: a write outside an array raises IndexError instead of changing foreign memory."""
    monkeypatch.setattr(module, "_follow_windows", module._follow_windows.py_func)


def double_pyramid(sides: int) -> Mesh:
    """Two tips of degree ``sides`` above and below one ring, not quite regular, so that no two paths tie."""
    angles = 2 * np.pi * (np.arange(sides) + 0.2 * np.sin(np.arange(sides))) / sides
    ring = np.stack((np.cos(angles), np.sin(angles), np.zeros(sides)), axis=1)
    this = np.arange(sides)
    following = np.roll(this, -1)
    upper = np.stack((this, following, np.full(sides, sides)), axis=1)
    lower = np.stack((following, this, np.full(sides, sides + 1)), axis=1)
    return Mesh(np.concatenate((ring, [[0.1, 0, 1], [0, 0.1, -1]])), np.concatenate((upper, lower)))


@pytest.mark.parametrize("sides", [3, 4, 50, WINDOWS - 1, WINDOWS, WINDOWS + 1, 3000])
@pytest.mark.parametrize("surface", [capped_cylinder, double_pyramid])
def test_any_degree_of_a_vertex(surface, sides):
    mesh = surface(sides)
    graph = geodesic_graph(mesh)
    degrees = np.diff(graph.starts)
    assert degrees[-2:].min() >= sides
    assert np.isfinite(graph.lengths).all()


@pytest.mark.usefixtures("interpreted")
@settings(max_examples=40)
@given(
    sides=st.integers(3, 40),
    budget=st.integers(-1, 60),
    surface=st.sampled_from([capped_cylinder, double_pyramid]),
    seed=st.integers(0, 99),
)
def test_any_budget_at_any_degree(sides, budget, surface, seed):
    """Small degrees and small budgets meet in every way, also on a crumpled surface, where windows split more often."""
    mesh = surface(sides)
    mesh = mesh.with_vertices(mesh.vertices + 0.5 * np.random.default_rng(seed).standard_normal(mesh.vertices.shape))
    mesh, _ = relabelled(mesh, seed)
    assert np.isfinite(geodesic_graph(mesh, budget).lengths).all()


@pytest.mark.usefixtures("interpreted")
def test_coordinates_whose_squares_overflow_stay_inside_the_arrays():
    mesh = double_pyramid(30)
    with np.errstate(all="ignore"):
        geodesic_graph(mesh.with_vertices(mesh.vertices * 1e160))


def test_distances_on_a_finely_capped_cylinder(sides=799):
    """From the centre of a cap: 1 to its corners, a little less than 3, through the middle of a side, to the others."""
    mesh = capped_cylinder(sides)
    from_top = shortest_paths(geodesic_graph(mesh), np.array([2 * sides + 1]))[0]
    np.testing.assert_allclose(from_top[sides : 2 * sides], 1.0, rtol=1e-6)
    np.testing.assert_allclose(from_top[:sides], 3.0, rtol=1e-5)
    assert from_top[2 * sides] == pytest.approx(4.0, rel=1e-5)

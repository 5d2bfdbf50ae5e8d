import time

import numpy as np
import pytest

from benchmark.errors import InvalidMesh
from benchmark.geometry import geodesics
from benchmark.geometry.bridging import bridge_components
from benchmark.geometry.cleaning import clean, fans_per_vertex
from benchmark.geometry.laplacian import cotangent_laplacian, eigenpairs
from benchmark.geometry.mesh import Mesh
from tests.geometry.surfaces import flat_grid, joined, sphere


def moved(mesh, *offset):
    return mesh.with_vertices(mesh.vertices + np.array(offset, dtype=float))


def oriented(mesh):
    """No two faces run along an edge in the same direction."""
    sides = np.stack((mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()), axis=1)
    return len(np.unique(sides, axis=0)) == len(sides)


def assert_one_manifold(mesh):
    assert_joined(mesh)
    geodesics.all_pairs(mesh, "exact")
    values, _ = eigenpairs(cotangent_laplacian(mesh), 2)
    assert values[1] > 1e-9


def assert_joined(mesh):
    _, report = clean(mesh)
    assert (report.components, report.non_manifold_edges, report.duplicate_faces, report.unreferenced) == (1, 0, 0, 0)
    assert (fans_per_vertex(mesh) == 1).all()


def test_two_squares_side_by_side():
    """A gap of 1 between two unit squares becomes a strip of two triangles along facing edges."""
    pair = joined(flat_grid(2), moved(flat_grid(2), 2, 0, 0))
    bridged, count = bridge_components(pair)
    assert count == 1
    np.testing.assert_array_equal(bridged.vertices, pair.vertices)
    np.testing.assert_array_equal(bridged.faces[:4], pair.faces)
    assert bridged.n_faces == 6
    assert bridged.area == pytest.approx(3.0)
    assert oriented(bridged)
    assert_one_manifold(bridged)
    assert geodesics.all_pairs(bridged, "exact")[0, 5] == pytest.approx(3.0)


def test_links_form_the_minimum_spanning_tree():
    """Four squares in a row with gaps 1, 2, 3: the three gaps are bridged, nothing else."""
    row = joined(*(moved(flat_grid(2), x, 0.1 * x, 0) for x in (0, 2, 5, 9)))
    bridged, count = bridge_components(row)
    assert count == 3
    pieces = np.repeat(np.arange(4), 4)
    joints = {tuple(sorted({int(piece) for piece in pieces[face]})) for face in bridged.faces[8:]}
    assert joints == {(0, 1), (1, 2), (2, 3)}
    assert_one_manifold(bridged)


def test_many_bridges_at_one_single_triangle():
    """A triangle amid twelve others has three edges only; bridges also start at edges of bridges."""
    triangle = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0]], [[0, 1, 2]])
    angles = np.arange(12) / 12 * 2 * np.pi
    star = joined(
        triangle,
        *(moved(triangle, 9 * np.cos(angle), 9 * np.sin(angle), 5 * (-1) ** at) for at, angle in enumerate(angles)),
    )
    bridged, count = bridge_components(star)
    assert count == 12
    assert_one_manifold(bridged)
    assert oriented(bridged)


def test_closed_components_are_opened_at_the_anchor():
    pair = joined(sphere(1), moved(sphere(1), 4, 0, 0))
    bridged, count = bridge_components(pair)
    assert count == 1
    assert bridged.n_faces == 80 - 1 + 80 - 1 + 2
    assert_one_manifold(bridged)
    assert oriented(bridged)


def test_open_components_are_joined_at_the_boundary_only():
    """A tall tent beside a square: its peak is nearer than its rim, but only the rim is free."""
    tent = Mesh(
        [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [3.9, 1, 0.5]], [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    )
    bridged, _ = bridge_components(joined(tent, moved(flat_grid(2), 4, 0.5, 0.5)))
    assert all(4 not in face for face in bridged.faces[6:])
    assert_one_manifold(bridged)


def test_touching_components_are_welded():
    """Squares that share a corner position, and squares that share an edge position."""
    at_corner, count = bridge_components(joined(flat_grid(2), moved(flat_grid(2), 1, 1, 0)))
    assert (count, at_corner.n_vertices, at_corner.n_faces) == (1, 7, 5)
    assert_one_manifold(at_corner)
    along_edge, count = bridge_components(joined(flat_grid(2), moved(flat_grid(2), 1, 0, 0)))
    assert (count, along_edge.n_vertices, along_edge.n_faces) == (1, 6, 4)
    assert along_edge.area == pytest.approx(2.0)
    assert_one_manifold(along_edge)


def test_vertices_without_faces_go():
    grid = flat_grid(3)
    bridged, count = bridge_components(Mesh([*grid.vertices, [0, 0, 9]], grid.faces))
    assert (count, bridged.n_vertices) == (0, 9)
    with pytest.raises(InvalidMesh, match="without faces"):
        bridge_components(Mesh(grid.vertices, np.empty((0, 3))))


def test_a_hundred_random_pieces():
    generator = np.random.default_rng(0)
    pieces = [
        moved(flat_grid(int(generator.integers(2, 10))), *(12 * generator.permutation(100)[:2]), generator.normal())
        for _ in range(96)
    ] + [moved(sphere(1), *generator.normal(0, 300, 3)) for _ in range(4)]
    mesh = joined(*pieces)
    start = time.process_time()
    bridged, count = bridge_components(mesh)
    seconds = time.process_time() - start
    again, _ = bridge_components(mesh)
    np.testing.assert_array_equal(bridged.faces, again.faces)
    assert count == 99
    assert_joined(bridged)
    assert seconds < 10  # about 0.03 s; half an hour if every pair of vertices were looked at

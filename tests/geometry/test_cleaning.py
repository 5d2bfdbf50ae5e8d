import numpy as np
import pytest

from benchmark.geometry.cleaning import (
    clean,
    component_areas,
    connected_components,
    fans_per_vertex,
    largest_component,
    make_manifold,
)
from benchmark.geometry.mesh import Mesh, edges_of
from tests.geometry.surfaces import flat_grid, joined, relabelled, sphere


def test_a_clean_mesh_comes_back_as_it_was():
    mesh, _ = relabelled(sphere(2))
    cleaned, report = clean(mesh)
    for result in (cleaned, make_manifold(mesh)):
        np.testing.assert_array_equal(result.vertices, mesh.vertices)
        np.testing.assert_array_equal(result.faces, mesh.faces)
    assert (report.components, report.boundary_edges, report.merged, report.degenerate_faces) == (1, 0, 0, 0)
    assert (report.duplicate_faces, report.unreferenced, report.non_manifold_edges) == (0, 0, 0)
    assert report.non_manifold_vertices == 0


def test_near_duplicates_are_not_welded():
    """Two sheets a hair's breadth apart are two surfaces."""
    sheet = flat_grid(3)
    above = sheet.with_vertices(sheet.vertices + np.array([0, 0, 1e-12]))
    assert clean(joined(sheet, above))[1].components == 2


def test_each_kind_of_debris_is_counted_once():
    mesh = Mesh(
        [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.0, 0, -0.0], [2, 0, 0]],
        [
            [1, 2, 3],  # good
            [4, 2, 3],  # the same through a duplicate vertex
            [2, 3, 1],  # the same, turned
            [1, 1, 3],  # repeated corner
            [1, 4, 3],  # repeated corner through a duplicate
            [1, 2, 5],  # collinear
        ],
    )
    cleaned, report = clean(mesh)
    assert (cleaned.n_vertices, cleaned.n_faces) == (3, 1)
    assert (report.merged, report.degenerate_faces, report.duplicate_faces, report.unreferenced) == (1, 3, 2, 2)
    assert (report.vertices_before, report.faces_before, report.boundary_edges) == (6, 6, 3)


def test_largest_is_by_area_not_by_count():
    mesh = joined(flat_grid(10, spacing=0.01), flat_grid(2, spacing=5.0))
    areas, of_face = component_areas(mesh)
    np.testing.assert_allclose(areas, [0.0081, 25.0])
    assert np.bincount(of_face).tolist() == [162, 2]
    assert largest_component(mesh).n_vertices == 4


def test_internal_wall_is_removed_and_the_surface_stays():
    """Two boxes' worth of sheet with a small fin on a common edge: the fin goes."""
    grid = flat_grid(4)
    fin = Mesh([*grid.vertices, [1.5, 1.0, 0.2]], [*grid.faces, [5, 6, 16]])
    assert (edges_of(fin.faces).counts == 3).sum() == 1
    corrected = make_manifold(fin)
    assert edges_of(corrected.faces).counts.max() == 2
    assert corrected.n_faces == grid.n_faces
    assert corrected.area == pytest.approx(grid.area)


def test_vertices_where_fans_meet_are_split():
    bow = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [0, 3, 4]])
    assert fans_per_vertex(bow).tolist() == [2, 1, 1, 1, 1]
    split = make_manifold(bow)
    assert split.n_vertices == 6
    assert (fans_per_vertex(split) == 1).all()
    assert connected_components(split).max() == 1
    np.testing.assert_array_equal(split.vertices[split.faces], bow.vertices[bow.faces])

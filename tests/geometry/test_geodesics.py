"""Geodesics, the Laplacian and interpolation beside independent implementations, on surfaces whose
values are known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist
from trimesh import creation

from benchmark.errors import UnsupportedShape
from benchmark.geometry import geodesic_graph as kernels
from benchmark.geometry import geodesics
from benchmark.geometry.cleaning import compact
from benchmark.geometry.geodesic_graph import WINDOWS, geodesic_graph
from benchmark.geometry.geodesics import shortest_paths
from benchmark.geometry.laplacian import cotangent_laplacian, eigenpairs
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from tests.geometry.surfaces import (
    capped_cylinder,
    exact_distances,
    flat_grid,
    joined,
    limbed_body,
    relabelled,
    sphere,
)

BODY = prepare(limbed_body(), 500).mesh
TETRAHEDRON = Mesh(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
)


@pytest.mark.kernels
@pytest.mark.parametrize("build", [Mesh.edge_graph, geodesic_graph])
def test_shortest_paths_agree_with_scipy(build: Callable[[Mesh], csr_array]) -> None:
    graph = build(BODY)
    truth = dijkstra(graph, directed=False)
    np.testing.assert_allclose(shortest_paths(graph, np.arange(BODY.n_vertices)), truth, rtol=2e-6)


def test_distances_known_by_hand_and_near_the_exact_ones() -> None:
    """Two unit right triangles folded along their hypotenuse: the geodesic is the diagonal of the
    unfolded square.
    """
    folded = Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, np.sqrt(0.5)]], [[0, 1, 2], [1, 3, 2]]
    )
    assert geodesics.all_pairs(folded)[0, 3] == pytest.approx(np.sqrt(2), rel=1e-6)
    mesh = prepare(limbed_body(5), 2000).mesh
    sources = np.arange(0, mesh.n_vertices, 200)
    exact, distances = exact_distances(mesh, sources), geodesics.from_sources(mesh, sources)
    errors = np.abs(distances - exact)[exact > 0] / exact[exact > 0]
    assert errors.mean() < 0.0008
    assert np.percentile(errors, 95) < 0.003


@pytest.mark.kernels
def test_all_pairs_are_a_metric_whose_rows_are_those_of_few_sources() -> None:
    mesh, matrix = BODY, geodesics.all_pairs(BODY)
    np.testing.assert_array_equal(matrix, matrix.T)
    assert not matrix.diagonal().any()
    sources = np.array([7, 40, 7, 0])
    rows = geodesics.from_sources(mesh, sources)
    np.testing.assert_allclose(rows, matrix[sources], rtol=1e-6, atol=1e-12)
    assert geodesics.from_sources(mesh, []).shape == (0, mesh.n_vertices)
    np.testing.assert_array_equal(geodesics.rounded(matrix), matrix.astype(np.float32))
    for row, source in zip(rows, sources, strict=True):
        np.testing.assert_array_equal(row, geodesics.from_sources(mesh, source)[0])
    assert (matrix >= cdist(mesh.vertices, mesh.vertices) * (1 - 1e-5)).all()
    for middle in range(0, mesh.n_vertices, 25):
        assert (matrix <= (matrix[:, [middle]] + matrix[[middle], :]) * (1 + 1e-5)).all()


@settings(max_examples=10)
@given(exponent=st.integers(-40, 40), seed=st.integers(0, 9))
def test_scale_and_rigid_motion(exponent: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(random.standard_normal((3, 3)))
    mesh, scale = sphere(2), 10.0**exponent
    moved = mesh.with_vertices(scale * (mesh.vertices @ rotation.T + random.standard_normal(3)))
    np.testing.assert_allclose(
        geodesics.all_pairs(moved), scale * geodesics.all_pairs(mesh), rtol=2e-5
    )
    body = BODY.with_vertices(1e6 * BODY.vertices @ rotation.T)
    found, expected = (eigenpairs(cotangent_laplacian(each), 6)[0] for each in (body, BODY))
    np.testing.assert_allclose(found[1:] * 1e12, expected[1:], rtol=1e-7)


def test_what_has_no_distances_is_refused() -> None:
    with pytest.raises(UnsupportedShape, match=r"2 components.*join"):
        geodesics.all_pairs(joined(TETRAHEDRON, TETRAHEDRON))
    for sources in ([4], [-1], [0, 99]):
        with pytest.raises(UnsupportedShape, match="source"):
            geodesics.from_sources(TETRAHEDRON, sources)


def test_degenerate_triangles_are_harmless() -> None:
    """A flat triangle, and two vertices at one position: still finite, still a metric."""
    mesh = Mesh(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0], [1, 1, 0], [1, 2, 0]],
        [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 3, 4], [3, 2, 4], [4, 5, 0], [4, 2, 5]],
    )
    matrix = geodesics.all_pairs(mesh)
    assert (matrix[3, 4], matrix[0, 2]) == (0, pytest.approx(2))
    assert (matrix >= cdist(mesh.vertices, mesh.vertices) * (1 - 1e-6)).all()
    assert np.isfinite(matrix).all()


@pytest.mark.kernels
@settings(max_examples=30)
@given(sides=st.integers(3, 40), budget=st.integers(-1, 60), seed=st.integers(0, 99))
def test_the_arrays_of_the_windows_hold_every_window(sides: int, budget: int, seed: int) -> None:
    """Run as Python, where a write outside an array raises; on crumpled surfaces windows split more
    often.
    """
    mesh, _ = relabelled(capped_cylinder(sides), seed)
    mesh = mesh.with_vertices(
        mesh.vertices + 0.5 * np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    )
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        patch.setattr(kernels, "_follow_windows", kernels._follow_windows.py_func)
        assert np.isfinite(geodesic_graph(mesh, budget).data).all()
        geodesic_graph(mesh.with_vertices(mesh.vertices * 1e160), budget)


@pytest.mark.kernels
@pytest.mark.parametrize("sides", [WINDOWS - 1, WINDOWS, 3000])
def test_distances_on_a_finely_capped_cylinder(sides: int) -> None:
    """From the centre of a cap: 1 to its corners, a little less than 3, through the middle of a
    side, to the others.
    """
    mesh = capped_cylinder(sides)
    is_top, is_rim = mesh.vertices[:, 2] > 0, np.linalg.norm(mesh.vertices[:, :2], axis=1) > 0.5
    from_top = shortest_paths(geodesic_graph(mesh, WINDOWS), np.flatnonzero(is_top & ~is_rim))[0]
    np.testing.assert_allclose(from_top[is_top & is_rim], np.ones(sides), rtol=1e-6)
    np.testing.assert_allclose(from_top[~is_top & is_rim], np.full(sides, 3.0), rtol=1e-5)
    assert from_top[~is_top & ~is_rim] == pytest.approx(4.0, rel=1e-5)


def stretched(rows: int, columns: int, height: float, *, rolled: bool) -> Mesh:
    """A sheet of long triangles that is a unit wide, or rolled into a tube of radius 1."""
    sheet = flat_grid(max(rows, columns))
    inside = (sheet.vertices[sheet.faces] < [columns, rows, 1]).all(axis=(1, 2))
    x, y, _ = sheet.vertices.T / [[columns - 1], [(rows - 1) / height], [1]]
    turn = 2 * np.pi * x
    vertices = np.stack(
        [np.cos(turn), np.sin(turn), y] if rolled else [x, y, np.zeros(len(x))], axis=1
    )
    return compact(vertices, sheet.faces[inside])


@pytest.mark.kernels
@pytest.mark.parametrize(("rows", "columns"), [(4, 200), (5, 100)])
@pytest.mark.parametrize("rolled", [False, True])
def test_distances_on_thin_triangles_are_as_good_as_on_others(
    rows: int, columns: int, rolled: bool
) -> None:
    mesh = prepare(stretched(rows, columns, 6.0 if rolled else 1.0, rolled=rolled)).mesh
    sources = np.arange(0, mesh.n_vertices, 60)
    exact, found = exact_distances(mesh, sources), geodesics.from_sources(mesh, sources)
    errors = np.abs(found - exact)[exact > 0] / exact[exact > 0]
    assert errors.mean() < 0.005


@pytest.mark.kernels
@pytest.mark.parametrize(
    "solid", [creation.cone(0.5, 2, sections=200), creation.torus(1, 0.3, 6, 100)]
)
def test_distances_around_thin_fans_and_tubes_are_exact(solid: Any) -> None:
    mesh = Mesh(solid.vertices, solid.faces)
    sources = np.arange(0, mesh.n_vertices, 60)
    np.testing.assert_allclose(
        geodesics.from_sources(mesh, sources), exact_distances(mesh, sources), atol=1e-6
    )


@pytest.mark.parametrize("mesh", [BODY, flat_grid(7), joined(sphere(1), flat_grid(3))])
def test_the_laplacian_agrees_with_libigl_and_its_eigenpairs_solve_the_problem(mesh: Mesh) -> None:
    laplacian = cotangent_laplacian(mesh)
    vertices, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
    np.testing.assert_allclose(
        laplacian.stiffness.toarray(), -igl.cotmatrix(vertices, faces).toarray(), atol=1e-9
    )
    mass = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()
    np.testing.assert_allclose(laplacian.mass, mass, rtol=1e-12)
    for k in (1, 5, 40):
        values, functions = eigenpairs(laplacian, k)
        weighted = laplacian.mass[:, None] * functions
        np.testing.assert_allclose(functions.T @ weighted, np.eye(k), atol=1e-9)
        np.testing.assert_allclose(
            laplacian.stiffness @ functions, weighted * values, atol=1e-8 * max(values[-1], 1)
        )
        assert (np.diff(values) >= 0).all()


def test_slivers_and_flat_triangles_do_not_spoil_the_matrix() -> None:
    """A needle, a triangle without area and an unreferenced vertex beside a good square."""
    mesh = Mesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, -1e-9, 0], [2, 0, 0], [5, 5, 5]],
        [[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 1, 5]],
    )
    laplacian = cotangent_laplacian(mesh)
    matrix = laplacian.stiffness.toarray()
    assert np.abs(matrix).max() < 2e3
    assert np.linalg.eigvalsh(matrix).min() > -1e-9
    assert (laplacian.mass > 0).all()
    assert np.isfinite(eigenpairs(laplacian, 3)[1]).all()
    with pytest.raises(UnsupportedShape, match="no area"):
        cotangent_laplacian(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
    for k in (0, 13):
        with pytest.raises(UnsupportedShape, match="1 to 12"):
            eigenpairs(cotangent_laplacian(sphere(0)), k)

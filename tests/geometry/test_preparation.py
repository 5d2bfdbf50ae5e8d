"""From the mesh of a file to that of the methods: repaired, in one piece, and dependent on the shape alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from benchmark.api.contracts import Shape
from benchmark.errors import InvalidMesh
from benchmark.geometry import geodesics
from benchmark.geometry.bridging import bridge_components
from benchmark.geometry.cleaning import (
    clean,
    connected_components,
    fans_per_vertex,
    largest_component,
    make_manifold,
    topology,
)
from benchmark.geometry.laplacian import cotangent_laplacian, eigenpairs
from benchmark.geometry.mesh import Mesh, edges_of, in_spatial_order, sides_of
from benchmark.geometry.preparation import Prepared, prepare
from tests.geometry.surfaces import flat_grid, joined, limbed_body, relabelled, sphere

TRIANGLE = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
SQUARE = flat_grid(2)


def moved(mesh: Mesh, *offset: float, scale: float = 1.0) -> Mesh:
    return mesh.with_vertices(scale * mesh.vertices + np.array(offset or (0, 0, 0), dtype=float))


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with vertices, triangles and the first corner of each triangle in a random order."""
    random = np.random.default_rng(seed)
    mixed, _ = relabelled(mesh, seed)
    faces = mixed.faces[random.permutation(mesh.n_faces)]
    turned = (random.integers(3, size=(mesh.n_faces, 1)) + np.arange(3)) % 3
    return Mesh(mixed.vertices, np.take_along_axis(faces, turned, axis=1))


PIECES = joined(limbed_body(4), moved(sphere(3), 3, 0, 0, scale=0.5), moved(flat_grid(8), -4, 1, 1))
prepared_once = cache(prepare)
TORUS = trimesh.creation.torus(2.0, 0.7, major_sections=100, minor_sections=50)


def assert_ready(prepared: Prepared) -> None:
    mesh = prepared.mesh
    assert mesh.area == pytest.approx(1.0)
    assert connected_components(mesh).max() == 0
    assert edges_of(mesh.faces).counts.max() <= 2
    assert (fans_per_vertex(mesh) == 1).all()
    assert all(isinstance(value, float) for value in prepared.report.values())


# --- the shape alone ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        lambda mesh: moved(mesh, scale=1 / 2.54),
        lambda mesh: moved(mesh, scale=100),
        lambda mesh: moved(mesh, scale=2.0**-300),
        lambda mesh: moved(mesh, 31.7, -8.3, 4.9),
        lambda mesh: renumbered(mesh, 1),
    ],
    ids=["inches", "metres", "tiny", "moved", "renumbered"],
)
@pytest.mark.parametrize("shape", [limbed_body(4), PIECES], ids=["body", "pieces"])
def test_a_decimated_mesh_does_not_depend_on_unit_place_and_numbering(
    shape: Mesh, change: Callable[[Mesh], Mesh]
) -> None:
    first, other = prepared_once(shape, 500), prepare(change(shape), 500)
    np.testing.assert_array_equal(other.mesh.faces, first.mesh.faces)
    np.testing.assert_allclose(other.mesh.vertices, first.mesh.vertices, rtol=0, atol=1e-9)
    assert other.report == pytest.approx(first.report, abs=1e-9)
    factor = np.sqrt(change(shape).area / shape.area)
    assert other.scale == pytest.approx(factor * first.scale)
    assert other.source_area == pytest.approx(factor**2 * first.source_area)
    corners = other.centre + other.scale * np.array([other.mesh.vertices.min(axis=0), other.mesh.vertices.max(axis=0)])
    np.testing.assert_allclose(corners[1] - corners[0], np.ptp(change(shape).vertices, axis=0), rtol=0.05)


def test_rounding_flattens_no_triangle() -> None:
    needle = Mesh([*SQUARE.vertices, [0.5, -1e-8, 0]], [*SQUARE.faces, [0, 4, 1]])
    assert prepare(needle).mesh.n_faces == 3
    assert (prepare(needle).mesh.face_areas > 0).all()


@pytest.mark.parametrize("mesh", [limbed_body(3), flat_grid(12), joined(sphere(1), flat_grid(4))])
def test_numbering_and_last_bits_of_coordinates_leave_nothing_in_the_order(mesh: Mesh) -> None:
    ordered = in_spatial_order(mesh)
    for seed in range(3):
        again = in_spatial_order(renumbered(mesh, seed))
        np.testing.assert_array_equal(again.vertices, ordered.vertices)
        np.testing.assert_array_equal(again.faces, ordered.faces)
    noise = 1e-13 * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    np.testing.assert_array_equal(in_spatial_order(mesh.with_vertices(mesh.vertices + noise)).faces, ordered.faces)


def test_draws_follow_from_seed_purpose_and_measurements_alone() -> None:
    mesh = limbed_body(3)

    def drawn(mesh: Mesh, name: str = "one", seed: int = 0, purpose: str = "") -> float:
        return Shape(identifier=name, mesh=mesh, seed=seed).random(purpose).random()

    other = mesh.with_vertices(2 * renumbered(mesh, 0).vertices[:, [1, 2, 0]] + 5.0)
    assert drawn(other) == drawn(mesh) == drawn(mesh, name="other")
    stretched = mesh.with_vertices(mesh.vertices * [1, 1, 1.001])
    others = [drawn(sphere(3)), drawn(mesh, seed=1), drawn(mesh, purpose="x"), drawn(stretched)]
    assert len({drawn(mesh), *others}) == 5


# --- decimation, repair, debris ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mesh", "euler"),
    [(sphere(5), 2), (limbed_body(5), 2), (flat_grid(80), 1), (Mesh(TORUS.vertices, TORUS.faces), 0)],
    ids=["sphere", "body", "open", "torus"],
)
def test_vertex_count_is_met_and_topology_kept(mesh: Mesh, euler: int) -> None:
    prepared = prepare(mesh, 300)
    assert prepared.mesh.n_vertices == pytest.approx(300, abs=3)
    assert prepared.report["euler_characteristic"] == euler
    assert prepared.source_area == pytest.approx(mesh.area)
    assert_ready(prepared)


@pytest.mark.parametrize("mesh", [sphere(2), flat_grid(4)])
def test_small_meshes_keep_their_vertices_and_know_their_numbers_in_the_file(mesh: Mesh) -> None:
    prepared = prepare(mesh)
    places = prepared.numbers_of(mesh)
    assert places is not None
    back = prepared.centre + prepared.scale * prepared.mesh.vertices[places]
    np.testing.assert_allclose(back, mesh.vertices, atol=2e-6 * prepared.scale)
    assert prepare(limbed_body(4), 500).numbers_of(limbed_body(4)) is None


def test_limbs_are_bridged_debris_is_dropped_and_the_report_says_so() -> None:
    body, limb, speck = sphere(4), moved(sphere(2), 1.4, 0, 0, scale=0.3), moved(sphere(1), 0, 3, 0, scale=0.01)
    prepared = prepare(joined(speck, body, limb), 1000)
    report = prepared.report
    assert (report["components"], report["dropped_components"], report["bridges"]) == (3, 1, 1)
    assert report["lost_area"] == pytest.approx(speck.area / (speck.area + body.area + limb.area), abs=1e-6)
    assert prepared.source_area == pytest.approx(body.area + limb.area)
    assert prepared.notes == {"joined_pieces": 2.0, "largest_gap": pytest.approx(0.1, abs=0.02)}
    assert prepare(body, 1000).notes == {}
    assert_ready(prepared)


@pytest.mark.parametrize("count", [60, 120, 1000])
def test_equal_pieces_are_bridged_and_debris_is_a_hundredth_in_all(count: int) -> None:
    """Small spheres in a row, a gap of 0.1 between them."""
    prepared = prepare(joined(*(moved(sphere(0), 0.3 * at, 3, 0, scale=0.1) for at in range(count))))
    assert prepared.report["dropped_components"] == count // 100
    assert prepared.report["bridges"] == count - count // 100 - 1
    assert prepared.notes["largest_gap"] < 0.2 or count > 100
    assert_ready(prepared)


def test_triangles_that_are_stored_one_by_one_with_a_wall_become_the_surface_again() -> None:
    ball = sphere(3)
    corners = ball.vertices[ball.faces].reshape(-1, 3)
    faces, wall = np.arange(len(corners)).reshape(-1, 3), [0, 1, len(corners)]
    prepared = prepare(Mesh([*corners, 0.51 * (corners[0] + corners[1])], [*faces, wall]))
    assert prepared.mesh.n_vertices == ball.n_vertices
    assert_ready(prepared)


FAR = limbed_body(3).vertices.copy()
FAR[17] *= 1e160
REFUSED = {
    "one triangle": (Mesh(TRIANGLE, [[0, 1, 2]]), "3 vertices remain"),
    "collinear": (
        Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[0, 1, 2], [1, 2, 3]]),
        "2 of 2 triangles",
    ),
    "one point": (Mesh([[1, 1, 1]] * 5, [[0, 1, 2], [2, 3, 4]]), "extent 0; pass a surface of positive size"),
    "no faces": (Mesh(FAR[:9], np.empty((0, 3))), "extent 0"),
    "empty": (Mesh(np.empty((0, 3)), np.empty((0, 3))), "extent 0"),
    "stray vertex": (Mesh(FAR, limbed_body(3).faces), "extent"),
    "stray, smaller": (Mesh(FAR * 1e-80, limbed_body(3).faces), "1 vertex beyond 100 radii of the shape; remove stray"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_surface_is_refused_with_a_hint(name: str) -> None:
    mesh, reason = REFUSED[name]
    with pytest.raises(InvalidMesh, match=reason) as caught:
        prepare(mesh)
    assert caught.value.hint


def test_each_kind_of_debris_is_counted_once() -> None:
    mesh = Mesh(
        [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.0, 0, -0.0], [2, 0, 0]],
        [[1, 2, 3], [4, 2, 3], [2, 3, 1], [1, 1, 3], [1, 4, 3], [1, 2, 5]],  # good, twice the same, three without area
    )
    cleaned, report = clean(mesh)
    assert (cleaned.n_vertices, cleaned.n_faces) == (3, 1)
    assert [report[n] for n in ("merged", "degenerate_faces", "duplicate_faces", "unreferenced")] == [1, 3, 2, 2]
    assert largest_component(joined(flat_grid(10, spacing=0.01), flat_grid(2, spacing=5.0))).n_vertices == 4


def test_walls_go_and_vertices_where_fans_meet_are_split() -> None:
    grid = flat_grid(4)
    corrected = make_manifold(Mesh([*grid.vertices, [1.5, 1.0, 0.2]], [*grid.faces, [5, 6, 16]]))
    assert edges_of(corrected.faces).counts.max() == 2
    assert corrected.area == pytest.approx(grid.area)
    bow = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [0, 3, 4]])
    split = make_manifold(bow)
    assert (fans_per_vertex(bow).tolist(), fans_per_vertex(split).tolist()) == ([2, 1, 1, 1, 1], [1] * 6)
    np.testing.assert_array_equal(split.vertices[split.faces], bow.vertices[bow.faces])


@given(st.lists(st.tuples(*[st.integers(0, 9)] * 3), max_size=30))
def test_edges_of_any_triangles_are_those_of_numpy(triangles: list[tuple[int, int, int]]) -> None:
    faces = np.array(triangles, dtype=np.int32).reshape(-1, 3)
    edges = edges_of(faces)
    rows = np.sort(np.stack(sides_of(faces), axis=1), axis=1)
    ends, of_sides, counts = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    np.testing.assert_array_equal(edges.ends, ends)
    np.testing.assert_array_equal(edges.of_sides, of_sides.reshape(-1))
    np.testing.assert_array_equal(edges.counts, counts)
    np.testing.assert_array_equal(edges.grouped_sides, np.argsort(edges.of_sides, kind="stable"))


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "NaN"),
        (TRIANGLE, [[0, 1, 3]], "name vertices 0 to 3 of 3, counted from 0"),
        (TRIANGLE, [[-1, 1, 2]], "name vertices -1 to 2"),
        (TRIANGLE, [[0, 1, 2, 2]], "shape"),
        (TRIANGLE + 0j, [[0, 1, 2]], "vertices are of type complex128, not real numbers"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "faces are of type float64, not integers"),
        (TRIANGLE, [[0, 1, 2**32 + 2]], "name vertices 0 to 4294967298"),
        ([[0, 0], [1, 0, 0]], [[0, 1, 2]], "vertices are no array"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(vertices: object, faces: object, words: str) -> None:
    with pytest.raises(InvalidMesh, match=words):
        Mesh(vertices, faces)  # type: ignore[arg-type]
    mesh = Mesh(TRIANGLE, [[0, 1, 2]])  # type: ignore[arg-type]
    assert mesh.area == 6.0
    for array in (mesh.vertices, mesh.faces, mesh.face_areas):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


# --- bridging ----------------------------------------------------------------------------------------------------


def assert_one_oriented_manifold(mesh: Mesh) -> None:
    report = clean(mesh)[1] | topology(mesh)
    assert [report[n] for n in ("components", "non_manifold_edges", "duplicate_faces", "unreferenced")] == [1, 0, 0, 0]
    assert (fans_per_vertex(mesh) == 1).all()
    sides = np.stack(sides_of(mesh.faces), axis=1)
    assert len(np.unique(sides, axis=0)) == len(sides)
    geodesics.all_pairs(mesh, "exact")
    assert eigenpairs(cotangent_laplacian(mesh), 2)[0][1] > 1e-9


LONE = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
ANGLES = np.arange(12) / 12 * 2 * np.pi
BRIDGED = {
    "squares side by side": (joined(SQUARE, moved(SQUARE, 2, 0, 0)), [1.0], 8, 6),
    "sharing a corner": (joined(SQUARE, moved(SQUARE, 1, 1, 0)), [0.0], 7, 5),
    "sharing an edge": (joined(SQUARE, moved(SQUARE, 1, 0, 0)), [0.0], 6, 4),
    "a star around a triangle": (
        joined(LONE, *(moved(LONE, 9 * np.cos(a), 9 * np.sin(a), 5 * (-1) ** k) for k, a in enumerate(ANGLES))),
        None, 39, 13 + 24,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BRIDGED)
def test_pieces_become_one_manifold_along_their_shortest_tree(name: str) -> None:
    mesh, gaps, n_vertices, n_faces = BRIDGED[name]
    bridged, found = bridge_components(mesh)
    assert gaps is None or found == pytest.approx(gaps)
    assert (bridged.n_vertices, bridged.n_faces) == (n_vertices, n_faces)
    assert_one_oriented_manifold(bridged)


def test_gaps_are_those_of_scipys_spanning_tree_of_many_random_pieces() -> None:
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial.distance import cdist

    random = np.random.default_rng(0)
    places = [(*(12 * random.permutation(100)[:2]), random.normal()) for _ in range(60)]
    pieces = [moved(flat_grid(2), *place) for place in places] + [moved(sphere(1), *random.normal(0, 300, 3))]
    bridged, gaps = bridge_components(joined(*pieces))
    distances = np.array([[cdist(a.vertices, b.vertices).min() for a in pieces] for b in pieces])
    np.testing.assert_allclose(np.sort(gaps), np.sort(minimum_spanning_tree(distances).data))
    assert_one_oriented_manifold(bridged)


def test_an_open_piece_is_joined_at_its_rim_and_vertices_without_faces_go() -> None:
    """A tall tent beside a square: its peak is nearer than its rim, but only the rim is free."""
    corners = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [3.9, 1, 0.5]]
    tent = Mesh(corners, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])  # type: ignore[arg-type]
    bridged, _ = bridge_components(joined(tent, moved(SQUARE, 4, 0.5, 0.5)))
    assert all(4 not in face for face in bridged.faces[6:])
    bridged, gaps = bridge_components(Mesh([*SQUARE.vertices, [0, 0, 9]], SQUARE.faces))  # type: ignore[arg-type]
    assert (gaps, bridged.n_vertices) == ([], 4)
    with pytest.raises(InvalidMesh, match="without faces"):
        bridge_components(Mesh(SQUARE.vertices, np.empty((0, 3))))  # type: ignore[arg-type]

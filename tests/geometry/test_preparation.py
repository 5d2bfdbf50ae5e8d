"""From the mesh of a file to that of the methods: repaired, in one piece, and dependent on the
shape alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from benchmark.api.contracts import Shape
from benchmark.datasets.checking import changes_of
from benchmark.datasets.mesh_files import read_mesh
from benchmark.errors import InvalidMesh
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
from tests.geometry.surfaces import (
    exact_distances,
    flat_grid,
    flipped,
    joined,
    limbed_body,
    relabelled,
    soup,
    sphere,
)

TRIANGLE = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
SQUARE = flat_grid(2)
INPUTS = Path(__file__).with_name("inputs")


def moved(mesh: Mesh, *offset: float, scale: float = 1.0) -> Mesh:
    return mesh.with_vertices(scale * mesh.vertices + np.array(offset or (0, 0, 0), dtype=float))


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with vertices, triangles and the first corner of each triangle in a random
    order.
    """
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


def assert_same(one: Mesh, other: Mesh) -> None:
    np.testing.assert_array_equal(one.faces, other.faces)
    np.testing.assert_allclose(one.vertices, other.vertices, rtol=0, atol=1e-9)


# --- the shape alone
# ---------------------------------------------------------------------------------------------


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
    assert_same(other.mesh, first.mesh)
    assert other.report == pytest.approx(first.report, abs=1e-9)
    factor = np.sqrt(change(shape).area / shape.area)
    assert other.scale == pytest.approx(factor * first.scale)
    assert other.source_area == pytest.approx(factor**2 * first.source_area)
    corners = other.centre + other.scale * np.array(
        [other.mesh.vertices.min(axis=0), other.mesh.vertices.max(axis=0)]
    )
    np.testing.assert_allclose(
        corners[1] - corners[0], np.ptp(change(shape).vertices, axis=0), rtol=0.05
    )


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
    np.testing.assert_array_equal(
        in_spatial_order(mesh.with_vertices(mesh.vertices + noise)).faces, ordered.faces
    )


def test_draws_follow_from_seed_purpose_and_measurements_alone() -> None:
    mesh = limbed_body(3)

    def drawn(mesh: Mesh, name: str = "one", seed: int = 0, purpose: str = "") -> float:
        return Shape(identifier=name, mesh=mesh, seed=seed).random(purpose).random()

    other = mesh.with_vertices(2 * renumbered(mesh, 0).vertices[:, [1, 2, 0]] + 5.0)
    assert drawn(other) == drawn(mesh) == drawn(mesh, name="other")
    stretched = mesh.with_vertices(mesh.vertices * [1, 1, 1.001])
    others = [drawn(sphere(3)), drawn(mesh, seed=1), drawn(mesh, purpose="x"), drawn(stretched)]
    assert len({drawn(mesh), *others}) == 5


# --- decimation, repair, debris
# ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mesh", "euler"),
    [
        (sphere(5), 2),
        (limbed_body(5), 2),
        (flat_grid(80), 1),
        (Mesh(TORUS.vertices, TORUS.faces), 0),
    ],
    ids=["sphere", "body", "open", "torus"],
)
def test_vertex_count_is_met_and_topology_kept(mesh: Mesh, euler: int) -> None:
    prepared = prepare(mesh, 300)
    assert prepared.mesh.n_vertices == pytest.approx(300, abs=0.75)
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
    body, limb, speck = (
        sphere(4),
        moved(sphere(2), 1.4, 0, 0, scale=0.3),
        moved(sphere(1), 0, 3, 0, scale=0.01),
    )
    prepared = prepare(joined(speck, body, limb), 1000)
    report = prepared.report
    assert (report["components"], report["dropped_components"], report["bridges"]) == (3, 1, 1)
    assert report["lost_area"] == pytest.approx(
        speck.area / (speck.area + body.area + limb.area), abs=1e-6
    )
    assert prepared.source_area == pytest.approx(body.area + limb.area)
    assert prepared.notes == {"joined_pieces": 2.0, "largest_gap": pytest.approx(0.1, abs=0.02)}
    assert prepare(body, 1000).notes == {}
    assert_ready(prepared)


@pytest.mark.parametrize("count", [60, 120, 1000])
def test_equal_pieces_are_bridged_and_debris_is_a_hundredth_in_all(count: int) -> None:
    """Small spheres in a row, a gap of 0.1 between them."""
    prepared = prepare(
        joined(*(moved(sphere(0), 0.3 * at, 3, 0, scale=0.1) for at in range(count)))
    )
    assert prepared.report["dropped_components"] == count // 100
    assert prepared.report["bridges"] == count - count // 100 - 1
    assert prepared.notes["largest_gap"] < 0.2 or count > 100
    assert_ready(prepared)


FAR = limbed_body(3).vertices.copy()
FAR[17] *= 1e160
#: In coordinates of a map, in single precision; and as a file of seven digits writes them.
ON_MAP = np.array([448262.3, 5411932.7, 112.0])
MAPPED = (limbed_body(3).vertices + ON_MAP).astype(np.float32)
SEVEN_DIGITS = MAPPED.astype(str).astype(float)
REFUSED = {
    "one triangle": (Mesh(TRIANGLE, [[0, 1, 2]]), "3 vertices remain"),
    "collinear": (Mesh(np.outer(range(4), [1, 0, 0]), [[0, 1, 2], [1, 2, 3]]), "2 of 2 triangles"),
    "one point": (
        Mesh([[1, 1, 1]] * 5, [[0, 1, 2], [2, 3, 4]]),
        "extent 0; pass a surface of positive size",
    ),
    "too small": (Mesh(TRIANGLE * 2.5e-101, [[0, 1, 2]]), "extent 1e-100"),
    "no faces": (Mesh(FAR[:9], np.empty((0, 3))), "extent 0"),
    "stray vertex": (Mesh(FAR, limbed_body(3).faces), "extent"),
    "single precision": (
        Mesh(MAPPED, limbed_body(3).faces),
        "5411934 in single precision are too coarse",
    ),
    "seven digits": (
        Mesh(SEVEN_DIGITS, limbed_body(3).faces),
        "in single precision are too coarse .* move it",
    ),
    "two decimals": (
        Mesh(MAPPED.astype(float).round(2), limbed_body(3).faces),
        "in single precision are too coarse",
    ),
    "one decimal": (
        Mesh(MAPPED.astype(float).round(1), limbed_body(3).faces),
        "in single precision are too coarse",
    ),
    "stray, smaller": (
        Mesh(FAR * 1e-80, limbed_body(3).faces),
        "1 vertex beyond 100 radii of the shape; remove stray",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_surface_is_refused_with_a_hint(name: str) -> None:
    mesh, reason = REFUSED[name]
    with pytest.raises(InvalidMesh, match=reason) as caught:
        prepare(mesh)
    assert caught.value.hint


def test_double_precision_far_from_the_origin_is_as_good_as_at_it() -> None:
    body = limbed_body(3)
    for far in (body.vertices + ON_MAP, (body.vertices + 1000.0).astype(np.float32)):
        assert prepare(Mesh(far, body.faces)).mesh.n_vertices == body.n_vertices


def test_each_kind_of_debris_is_counted_once() -> None:
    mesh = Mesh(
        [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.0, 0, -0.0], [2, 0, 0]],
        [
            [1, 2, 3],
            [4, 2, 3],
            [2, 3, 1],
            [1, 1, 3],
            [1, 4, 3],
            [1, 2, 5],
        ],  # good, twice the same, three without area
    )
    cleaned, report = clean(mesh)
    assert (cleaned.n_vertices, cleaned.n_faces) == (3, 1)
    assert [
        report[n] for n in ("merged", "degenerate_faces", "duplicate_faces", "unreferenced")
    ] == [1, 3, 2, 2]
    assert (
        largest_component(joined(flat_grid(10, spacing=0.01), flat_grid(2, spacing=5.0))).n_vertices
        == 4
    )


def test_walls_go_and_vertices_where_fans_meet_are_split() -> None:
    grid = flat_grid(4)
    corrected = make_manifold(Mesh([*grid.vertices, [1.5, 1.0, 0.2]], [*grid.faces, [5, 6, 16]]))
    assert edges_of(corrected.faces).counts.max() == 2
    assert corrected.area == pytest.approx(grid.area)
    bow = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [0, 3, 4]])
    split = make_manifold(bow)
    assert (fans_per_vertex(bow).tolist(), fans_per_vertex(split).tolist()) == (
        [2, 1, 1, 1, 1],
        [1] * 6,
    )
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
        (np.ma.masked_equal(TRIANGLE, 3), [[0, 1, 2]], "1 of 3 vertices are NaN or infinite"),
        (TRIANGLE, np.ma.masked_equal([[0, 1, 2]], 1), "faces are no array"),
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


# --- bridging
# ------------------------------------------------------------------------------------------------


def assert_one_oriented_manifold(mesh: Mesh) -> None:
    report = clean(mesh)[1] | topology(mesh)
    assert [
        report[n] for n in ("components", "non_manifold_edges", "duplicate_faces", "unreferenced")
    ] == [1, 0, 0, 0]
    assert (fans_per_vertex(mesh) == 1).all()
    sides = np.stack(sides_of(mesh.faces), axis=1)
    assert len(np.unique(sides, axis=0)) == len(sides)
    exact_distances(mesh, np.arange(mesh.n_vertices))
    assert eigenpairs(cotangent_laplacian(mesh), 2)[0][1] > 1e-9


LONE = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 0.9, 0]], [[0, 1, 2]])  # type: ignore[arg-type]
ANGLES = np.arange(12) / 12 * 2 * np.pi
BRIDGED = {
    "squares side by side": (joined(SQUARE, moved(SQUARE, 2, 0, 0)), [1.0], 8, 6),
    "sharing a corner": (joined(SQUARE, moved(SQUARE, 1, 1, 0)), [0.0], 7, 5),
    "sharing an edge": (joined(SQUARE, moved(SQUARE, 1, 0, 0)), [0.0], 6, 4),
    "a star around a triangle": (
        joined(
            LONE,
            *(
                moved(LONE, 9 * np.cos(a), 9 * np.sin(a), 5 * (-1) ** k)
                for k, a in enumerate(ANGLES)
            ),
        ),
        None,
        39,
        13 + 24,
    ),
}


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
    pieces = [moved(flat_grid(2), *place) for place in places] + [
        moved(sphere(1), *random.normal(0, 300, 3))
    ]
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
    empty = Mesh(SQUARE.vertices, np.empty((0, 3)))  # type: ignore[arg-type]
    assert bridge_components(empty)[0].n_vertices == 0


# --- one surface from copies, without triangles that have no area, oriented alike
# --------------------------------


@pytest.mark.parametrize("noise", [0, 1e-8, 1e-7, 1e-6])
@pytest.mark.parametrize(
    "shape", [limbed_body(3), flat_grid(20), Mesh(TORUS.vertices, TORUS.faces)]
)
def test_copies_that_rounding_moved_apart_are_one_vertex(shape: Mesh, noise: float) -> None:
    whole, scattered = prepared_once(shape, 5000), prepare(soup(shape, noise), 5000)
    assert scattered.mesh.n_vertices == whole.mesh.n_vertices
    assert scattered.mesh.n_faces == whole.mesh.n_faces
    for name in ("euler_characteristic", "components", "bridges", "boundary_edges"):
        assert scattered.report[name] == whole.report[name]
    assert scattered.mesh.area == pytest.approx(1)
    assert (
        np.abs(
            np.sort(scattered.mesh.vertices, axis=0) - np.sort(whole.mesh.vertices, axis=0)
        ).max()
        < 1e-5
    )


@given(st.permutations(range(8)), st.floats(0.9, 0.99))
def test_chains_of_near_vertices_are_merged_in_any_order(
    order: list[int], closeness: float
) -> None:
    grid = flat_grid(5)
    for step, n_vertices in ((closeness, 26), (1 / closeness, 33)):
        steps = step * 4e-6 * np.sqrt(20) * np.array(order)
        chain = np.stack([np.full(8, -1.0), steps, 0 * steps], axis=1)
        mesh = Mesh([*grid.vertices, *chain], [*grid.faces, *([25 + k, 0, 5] for k in range(8))])
        assert clean(mesh)[0].n_vertices == n_vertices


def test_a_shape_with_most_vertices_in_one_place_has_no_stray_ones() -> None:
    knob = moved(sphere(4), 0.0, 0.0, 0.0, scale=0.004)
    assert prepare(joined(knob, moved(flat_grid(30, 0.1), 0, 0, 0.01))).report["components"] == 2


def test_what_is_farther_apart_than_rounding_stays_apart_and_coincident_pieces_are_one() -> None:
    sheet = flat_grid(3)
    near, far = (
        clean(joined(sheet, moved(sheet, 0, 0, gap * 2 * np.sqrt(2))))[0]
        for gap in (3.9e-6, 4.1e-6)
    )
    assert (near.n_vertices, far.n_vertices) == (9, 18)
    for gap, n_vertices in (
        (4.9, 10),
        (5.1, 17),
    ):  # of all at the border but the first, which are copies
        over = sheet.vertices + np.outer([0.9, *[gap] * 8], [0, 0, 4e-6 * 2 * np.sqrt(2)])
        assert clean(joined(sheet, sheet.with_vertices(over)))[0].n_vertices == n_vertices
    twice = prepare(joined(sphere(2), soup(sphere(2), 1e-7), moved(sphere(0), 4, 0, 0)))
    assert twice.report["components"] == 2
    assert twice.report["duplicate_faces"] == 320


@pytest.mark.parametrize(
    "change",
    [lambda mesh: mesh, soup, lambda mesh: soup(mesh, 1e-7), lambda mesh: renumbered(mesh, 3)],
)
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_triangles_without_area_leave_no_border(
    change: Callable[[Mesh], Mesh], seed: int | None
) -> None:
    """A closed box of which halves meet at vertices on the longer edges of the other."""
    mesh = read_mesh(INPUTS / "sliver-rim.off")
    turn = (
        np.eye(3)
        if seed is None
        else np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    )
    prepared = prepare(change(mesh.with_vertices(mesh.vertices @ turn)))
    assert (prepared.report["euler_characteristic"], prepared.report["boundary_edges"]) == (2, 0)
    assert prepared.mesh.face_areas.min() > 1e-4
    places = (prepared.centre + prepared.scale * prepared.mesh.vertices) @ turn.T
    first, last = (
        int(np.linalg.norm(places - place, axis=1).argmin()) for place in ([0, 2, 2], [5, 1, 2])
    )
    distance = prepared.scale * exact_distances(prepared.mesh, np.array([first]))[0, last]
    assert distance == pytest.approx(np.sqrt(26), abs=1e-4)


@given(st.lists(st.integers(1, 99), min_size=1, max_size=8, unique=True), st.integers(0, 10**6))
def test_any_vertices_on_an_edge_are_joined_to_its_other_side(cuts: list[int], seed: int) -> None:
    """Above an edge a fan to the vertices on it, below a single triangle, between them flat
    triangles in any order.
    """
    random = np.random.default_rng(seed)
    line = [np.array([x / 100, 0, 0]) for x in [0, *sorted(cuts), 100]]
    n, chain, flat = len(line), list(range(len(line))), []
    while len(chain) > 2:
        at = int(random.integers(1, len(chain) - 1))
        flat.append([chain[at - 1], chain.pop(at), chain[at] if at < len(chain) else chain[-1]])
    fan = [[n, k + 1, k] for k in range(n - 1)]
    mesh = Mesh([*line, [0.5, 1, 0], [0.5, -1, 0]], [*fan, *flat, [n + 1, 0, n - 1]])
    cleaned, report = clean(renumbered(mesh, seed))
    assert report["degenerate_faces"] == n - 2
    assert (cleaned.n_vertices, cleaned.n_faces, topology(cleaned)["boundary_edges"]) == (
        n + 2,
        2 * (n - 1),
        4,
    )
    assert cleaned.area == pytest.approx(1)
    assert topology(cleaned)["non_manifold_edges"] == 0


def test_flat_triangles_that_cannot_be_removed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmark.geometry.cleaning._MOST_ROUNDS", 1)
    with pytest.raises(InvalidMesh, match="triangles without area cannot be removed"):
        clean(read_mesh(INPUTS / "sliver-rim.off"))


@pytest.mark.parametrize(
    ("shape", "most"),
    [
        (limbed_body(3), 1.0),
        (
            joined(
                limbed_body(2), moved(sphere(2), 9, 0, 0), moved(flat_grid(12), 0, 9, 0, scale=0.3)
            ),
            0.3,
        ),
        (flat_grid(9), 0.4),
        (Mesh(limbed_body(3).vertices, limbed_body(3).faces[20:]), 1.0),  # with a hole
    ],
    ids=["closed", "pieces", "open", "holed"],
)
@pytest.mark.parametrize("n_vertices", [100, 2000])
def test_a_mesh_with_turned_faces_is_prepared_as_the_oriented_one(
    shape: Mesh, most: float, n_vertices: int
) -> None:
    whole = prepared_once(shape, n_vertices)
    assert whole.report["turned_faces"] == 0
    for share in (0.1 * most, 0.7 * most, most):
        other = prepare(flipped(renumbered(shape, 1), share, seed=2), n_vertices)
        assert_same(other.mesh, whole.mesh)
        assert other.report["turned_faces"] > 0
    assert (
        most < 0.5
        or trimesh.Trimesh(whole.mesh.vertices, whole.mesh.faces, process=False).volume >= 0
    )


def test_a_moebius_strip_is_noted_and_turned_as_far_as_it_goes() -> None:
    angle, across = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.array([[-0.5], [0.5]])
    reach = 2 + across * np.cos(angle / 2)
    rims = np.stack(
        [reach * np.cos(angle), reach * np.sin(angle), across * np.sin(angle / 2)], axis=2
    )
    near, far = np.arange(40), np.arange(40, 80)
    ahead, beyond = np.append(near[1:], far[0]), np.append(far[1:], near[0])
    faces = np.concatenate([np.stack([near, ahead, far], 1), np.stack([ahead, beyond, far], 1)])
    prepared = prepare(flipped(Mesh(rims.reshape(-1, 3), faces), 0.4))
    assert prepared.report["one_sided_components"] == 1
    assert any("1 one-sided piece" in what for what, _ in changes_of(prepared))
    starts, ends = sides_of(prepared.mesh.faces)
    twice = len(starts) - len(np.unique(np.stack([starts, ends], axis=1), axis=0))
    assert twice == 1  # one seam
    assert prepare(sphere(1)).report["one_sided_components"] == 0


def test_copies_become_one_at_their_mean() -> None:
    corners = [[0, 0, 0], [1 - 1e-6, 0, 0], [0, 1, 0], [1 + 1e-6, 0, 0], [1, 1, 0], [0, 1, 0]]
    cleaned, _ = clean(Mesh(corners, [[0, 1, 2], [3, 4, 5]]))
    np.testing.assert_allclose(
        cleaned.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], atol=1e-12
    )


def test_a_bridge_in_line_with_borders_has_area_and_its_length_is_that_in_the_file() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [3, -1, 0], [3, 0, 0]])
    prepared = prepare(Mesh(7 * corners, [[0, 1, 2], [3, 4, 5]]))
    assert prepared.notes == {"joined_pieces": 2, "largest_gap": pytest.approx(7, abs=1e-4)}
    assert connected_components(prepared.mesh).max() == 0
    assert prepared.mesh.face_areas.min() > 0.1


@pytest.mark.parametrize(("height", "lost"), [(1.2, 0.23), (1.4, 0.26), (1.9, 0.32)])
def test_what_loses_more_than_a_quarter_of_its_area_is_refused(height: float, lost: float) -> None:
    """Of three triangles at an edge, the smallest is dropped."""
    wall = Mesh(
        [[0, 0, 0], [1, 0, 0], [0.5, 2, 0], [0.5, -2, 0], [0.5, 0, height]],
        [[0, 1, 2], [1, 0, 3], [0, 1, 4]],
    )
    if lost < 0.25:
        assert prepare(wall).report["lost_area"] == pytest.approx(lost, abs=0.005)
    else:
        with pytest.raises(InvalidMesh, match=f"preparation would lose {lost:.0%} of the area"):
            prepare(wall)

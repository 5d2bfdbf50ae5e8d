import resource
import time

import numpy as np
import pytest
import trimesh

from benchmark.errors import InvalidMesh
from benchmark.geometry.cleaning import clean, connected_components, fans_per_vertex
from benchmark.geometry.mesh import Mesh, edges_of, in_spatial_order
from benchmark.geometry.preparation import decimate, prepare
from tests.geometry.surfaces import flat_grid, joined, limbed_body, sphere


def assert_ready(prepared):
    mesh = prepared.mesh
    assert mesh.area == pytest.approx(1.0)
    assert connected_components(mesh).max() == 0
    assert edges_of(mesh.faces).counts.max() <= 2
    assert (fans_per_vertex(mesh) == 1).all()
    assert prepared.report["vertices"] == mesh.n_vertices
    assert all(isinstance(value, float) for value in prepared.report.values())


def torus(sections=100):
    ring = trimesh.creation.torus(2.0, 0.7, major_sections=sections, minor_sections=sections // 2)
    return Mesh(ring.vertices, ring.faces)


@pytest.mark.parametrize(
    ("mesh", "euler"),
    [(sphere(5), 2), (limbed_body(5), 2), (flat_grid(80), 1), (torus(), 0)],
    ids=["sphere", "body", "open", "torus"],
)
def test_vertex_count_is_met_and_topology_kept(mesh, euler):
    count = 300
    prepared = prepare(mesh, count)
    assert abs(prepared.mesh.n_vertices - count) <= 0.01 * count
    assert prepared.report["euler_characteristic"] == euler
    assert prepared.source_area == pytest.approx(mesh.area)
    assert_ready(prepared)


def test_small_meshes_are_never_refined():
    for mesh in (sphere(2), flat_grid(4)):
        prepared = prepare(mesh)
        expected = in_spatial_order(mesh.with_vertices((mesh.vertices - prepared.centre) / prepared.scale))
        np.testing.assert_array_equal(prepared.mesh.faces, expected.faces)
        np.testing.assert_allclose(prepared.mesh.vertices, expected.vertices, atol=1e-12)
    assert decimate(sphere(2), 162) is not None


@pytest.mark.parametrize("scale", [2.0**-300, 2.0**300])
def test_unit_of_the_file_does_not_matter(scale):
    mesh = limbed_body(4)
    prepared = prepare(mesh.with_vertices(scale * mesh.vertices), 500)
    assert_ready(prepared)
    assert prepared.source_area == pytest.approx(mesh.area * scale**2)
    np.testing.assert_allclose(prepared.mesh.area, 1.0)


def test_limbs_are_bridged_and_debris_is_dropped():
    """A body, a limb of a few per cent of the area at a gap, and a speck."""
    body = sphere(4)
    limb = sphere(2).with_vertices(0.3 * sphere(2).vertices + [1.4, 0, 0])
    speck = sphere(1).with_vertices(0.01 * sphere(1).vertices + [0, 3, 0])
    prepared = prepare(joined(speck, body, limb), 1000)
    report = prepared.report
    assert (report["components"], report["dropped_components"], report["bridges"]) == (3, 1, 1)
    assert report["lost_area"] == pytest.approx(speck.area / (speck.area + body.area + limb.area), abs=1e-6)
    assert prepared.source_area == pytest.approx(body.area + limb.area)
    assert_ready(prepared)
    extent = np.ptp(prepared.mesh.vertices, axis=0)
    assert extent[0] / extent[1] == pytest.approx(2.7 / 2.0, rel=0.03)


def debris(count):
    """Equal small spheres in a row, each a component."""
    ball = sphere(0)
    return joined(*(ball.with_vertices(0.1 * ball.vertices + [0.3 * at, 3, 0]) for at in range(count)))


@pytest.mark.parametrize(
    "mesh",
    [
        debris(5000),
        joined(sphere(3), debris(60)),
        joined(*(Mesh(np.eye(3) + 2 * at, [[0, 1, 2]]) for at in range(1000)), sphere(0)),
    ],
    ids=["equal components", "as much debris as body", "soup of triangles"],
)
def test_a_shape_that_is_mostly_debris_is_refused(mesh):
    with pytest.raises(InvalidMesh, match=r"preparation would lose \d+% of the area: .* join what belongs together"):
        prepare(mesh)


def test_a_shape_that_vanishes_beside_a_stray_vertex_is_refused():
    body = limbed_body(3)
    far = body.vertices.copy()
    far[17] *= 1e160
    with pytest.raises(InvalidMesh, match="extent"):
        prepare(Mesh(far, body.faces))
    with pytest.raises(InvalidMesh, match=r"of 1280 triangles have no area; look for stray vertices"):
        prepare(Mesh(far * 1e-80, body.faces))


def test_dirty_mesh_is_repaired_and_the_report_says_how():
    ball = sphere(3)
    soup = ball.vertices[ball.faces].reshape(-1, 3)
    n = len(soup)
    dirty = Mesh(
        np.concatenate((soup, [[0, 0, 1.5], [7, 7, 7]])),
        np.concatenate((np.arange(n).reshape(-1, 3), [[0, 1, n], [0, 0, 1], [2, 1, 0]])),
    )
    prepared = prepare(dirty)
    report = prepared.report
    assert report["merged"] == n - ball.n_vertices
    assert (report["degenerate_faces"], report["duplicate_faces"], report["unreferenced"]) == (1, 1, 1)
    assert report["non_manifold_edges"] == 1
    assert report["boundary_edges"] == 2
    assert_ready(prepared)


@pytest.mark.parametrize(
    "mesh",
    [
        Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[0, 1, 2], [1, 2, 3]]),
        Mesh([[1, 1, 1]] * 5, [[0, 1, 2], [2, 3, 4]]),
        Mesh(np.random.default_rng(0).random((9, 3)), np.empty((0, 3))),
        Mesh(np.empty((0, 3)), np.empty((0, 3))),
        joined(*[Mesh([[0, 0, at], [1, 0, at], [0, 1, at]], [[0, 1, 2]]) for at in range(150)]),
    ],
    ids=["one triangle", "collinear", "one point", "no faces", "empty", "only lone triangles"],
)
def test_what_is_no_surface_is_refused_with_a_hint(mesh):
    with pytest.raises(InvalidMesh) as caught:
        prepare(mesh)
    assert caught.value.hint


@pytest.mark.exhaustive
@pytest.mark.timeout(900)  # half a minute on a quiet machine
def test_a_million_vertices():
    parts = [(sphere(8), 0.0), (sphere(7), 1.9), (sphere(7), 3.8), (flat_grid(135, spacing=0.01), 5.0)]
    mesh = joined(*(part.with_vertices(part.vertices + np.array([x, 0, 0])) for part, x in parts))
    assert mesh.n_vertices > 1_000_000
    start = time.process_time()
    prepared = prepare(mesh)
    assert time.process_time() - start < 60
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 3 * 2**20  # KiB; the test's own meshes included
    assert_ready(prepared)
    assert abs(prepared.mesh.n_vertices - 2000) <= 20


@pytest.mark.data
def test_tosca_needs_no_bridge(data_root):
    from benchmark.geometry.io import read_mesh

    for name in ("cat0", "gorilla1", "victoria10"):
        prepared = prepare(read_mesh(data_root / "tosca" / f"{name}.off"))
        assert abs(prepared.mesh.n_vertices - 2000) <= 20
        assert prepared.report["bridges"] == 0
        assert_ready(prepared)
        assert clean(prepared.mesh)[1].degenerate_faces == 0

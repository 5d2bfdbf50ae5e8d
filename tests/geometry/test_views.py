"""The depth image of a mesh and the surface behind it, against shapes whose depth is known in
closed form.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from benchmark.errors import BenchmarkError, ConfigurationError, InvalidMesh, UnsupportedShape
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.depth import (
    FEWEST_PIXELS,
    back_project,
    common_half_width,
    depth_surface,
    render_depth,
)
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.rasterise import depth_buffer
from tests.geometry.surfaces import joined, sphere

TOWARDS = Camera((0.0, 0.0, -1.0), up=(0.0, 1.0, 0.0))
"""Camera coordinates are the coordinates of the shape."""


def rectangle(width: float, height: float, z: float = 0.0, x: float = 0.0) -> Mesh:
    corners = [
        (x + a * width / 2, b * height / 2, z) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))


def test_the_top_left_of_an_image_is_up_and_to_the_left_on_the_surface() -> None:
    image = np.zeros((128, 128), dtype=np.float32)
    image[8:56, 8:56] = 0.5
    surface, _ = back_project(image, 1.0)
    assert (surface.vertices[:, 0] < 0).all()
    assert (surface.vertices[:, 1] > 0).all()


@pytest.mark.kernels
def test_rendering_agrees_with_ray_casting() -> None:
    pytest.importorskip("embreex")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    size = 96
    knot = trimesh.creation.torus(30, 12, major_sections=40, minor_sections=20)
    blob = trimesh.creation.icosphere(subdivisions=3, radius=22).apply_translation([20.3, 7.1, 5.0])
    scene = trimesh.util.concatenate([knot, blob])
    turned = scene.vertices @ Rotation.random(rng=1).as_matrix().T
    points = turned * [1, 1, 0.5] + [size / 2 + 0.013, size / 2 - 0.027, 0]
    image = depth_buffer(points, scene.faces, size, np.nan)
    columns, rows = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    origins = np.stack([columns.ravel(), rows.ravel(), np.full(size**2, -200.0)], axis=1)
    mesh = trimesh.Trimesh(points, scene.faces, process=False)
    directions = np.tile([0.0, 0, 1], (size**2, 1))
    hits, rays, _ = RayMeshIntersector(mesh).intersects_location(
        origins, directions, multiple_hits=False
    )
    expected = np.full(size**2, np.nan)
    expected[rays] = hits[:, 2]
    expected = expected.reshape(size, size)
    assert 2000 < len(rays) < size**2
    assert (np.isnan(expected) != np.isnan(image)).sum() <= 2  # rays that graze a silhouette
    assert np.nanquantile(np.abs(image - expected), 0.999) < 1e-3


@pytest.mark.kernels
@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), snap=st.sampled_from([0.0, 0.5, 1.0]))
def test_no_cracks_inside_a_triangulated_square(seed: int, snap: float) -> None:
    """Vertices on pixel centres and corners are the hard case: the centre lies on edges and
    vertices exactly.
    """
    inner = np.random.default_rng(seed).uniform(0, 24, (60, 2))
    inner = np.round(inner / snap) * snap if snap else inner
    flat = np.unique(np.concatenate([inner, [[-1, -1], [25, -1], [25, 25], [-1, 25]]]), axis=0)
    image = depth_buffer(np.c_[flat, flat[:, 0]], Delaunay(flat).simplices, 24, np.inf)
    np.testing.assert_allclose(image, np.tile(np.arange(24) + 0.5, (24, 1)), atol=1e-4)


def test_a_sphere_has_its_analytic_depth_and_back_projection_inverts_it() -> None:
    ball = sphere(5)
    image = render_depth(ball.with_vertices(0.8 * ball.vertices), FRONT, half_width=1.0)
    y, x = np.meshgrid(
        (np.arange(500) + 0.5) / 250 - 1, (np.arange(500) + 0.5) / 250 - 1, indexing="ij"
    )
    inside = x**2 + y**2 < 0.7**2
    expected = (1 + np.sqrt(0.64 - x**2 - y**2, where=inside, out=np.zeros_like(x))) / 2
    assert image.dtype == np.float32
    assert np.abs(image - expected)[inside].max() < 2e-3
    assert not image[x**2 + y**2 > 0.8**2].any()
    surface, report = back_project(image, 3.0)
    assert np.abs(np.linalg.norm(surface.vertices, axis=1) - 2.4).max() < 5e-3
    assert (report["pieces"], report["bridges"], report["specks"]) == (1, 0, 0)
    assert report["foreground"] == pytest.approx(np.pi * 200**2, rel=0.002)
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert ((normals * (a + b + c)).sum(axis=1) > 0).mean() > 0.99


@pytest.mark.parametrize(
    ("step", "jump", "pieces"), [(0.02, 0.05, 1), (0.03, 0.05, 2), (0.03, 0.07, 1)]
)
def test_edges_across_a_jump_are_cut_and_bridged(step: float, jump: float, pieces: int) -> None:
    """A step in depth is half as large in units of the half width."""
    image = np.full((40, 40), 0.4, dtype=np.float32)
    image[:, 20:] += step
    surface, report = back_project(image, 1.0, stride=4, jump=jump)
    assert (report["pieces"], report["bridges"]) == (pieces, pieces - 1)
    assert surface.n_vertices == 100
    assert (
        len(
            trimesh.Trimesh(surface.vertices, surface.faces, process=False).split(
                only_watertight=False
            )
        )
        == 1
    )


def test_rounding_errors_choose_no_diagonal() -> None:
    """In a plane that both diagonals climb equally, each block is a tie."""
    tie = np.add.outer(np.zeros(40), np.linspace(0.4, 0.6, 40)).astype(np.float32)
    noise = np.random.default_rng(0).uniform(-1.2e-7, 1.2e-7, tie.shape)
    (surface, _), (noisy, _) = (
        back_project((tie + n).astype(np.float32), 1.0, stride=4) for n in (0, noise)
    )
    assert not np.array_equal(surface.vertices, noisy.vertices)
    np.testing.assert_array_equal(surface.faces, noisy.faces)


def test_shapes_that_do_not_fit_their_frame_are_refused_and_do_not_set_it() -> None:
    with pytest.raises(UnsupportedShape, match=r"half width of at least 1\.11111"):
        render_depth(rectangle(2.0, 1.0), TOWARDS, 1.0)
    with pytest.raises(UnsupportedShape, match="extends to"):
        render_depth(joined(rectangle(0.1, 0.1, z=-3), rectangle(0.1, 0.1, z=3)), TOWARDS, 1.0)
    usual = [0.8, 1.0, 1.0, 1.2]
    for odd in ([1e5], [6.0], [1e-5], [1e100, 1e99], [5.1, 1e-90]):
        assert common_half_width(usual + odd) == common_half_width(odd + usual) == 1.2
    for direction in ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (float("nan"), 0.0, 0.0)):
        with pytest.raises(ConfigurationError, match="parallel"):
            Camera(direction)


def test_views_of_few_pixels_or_of_scraps_are_refused_and_a_few_scraps_are_noted() -> None:
    wide = math.sqrt(FEWEST_PIXELS) / 250  # side of a square of as many pixels
    assert (
        depth_surface(rectangle(wide * 1.1, wide * 1.1), TOWARDS, 1.0).report["foreground"]
        >= FEWEST_PIXELS
    )
    for side in (wide * 0.9, 1e-9):
        with pytest.raises(
            UnsupportedShape, match=r"sees \d+ pixels of the shape, fewer than 200; check its unit"
        ):
            depth_surface(rectangle(side, side), TOWARDS, 1.0)
    # Sheets of 3 x 3 pixels, four pixels apart: at a stride of one each gives a speck of at most
    # nine samples.
    scrap = rectangle(2.2 / 250, 2.2 / 250)
    at = np.stack([*np.divmod(np.arange(400), 20), np.zeros(400)], axis=1) * 4 / 250
    scraps = [scrap.with_vertices(scrap.vertices + place) for place in at]
    report = depth_surface(joined(rectangle(0.4, 0.4, x=-0.5), *scraps[:40]), TOWARDS, 1.0).report
    assert 0 < report["lost_area"] < 0.5
    with pytest.raises(
        UnsupportedShape, match="% of what the camera sees belongs to no piece of 8 samples"
    ):
        depth_surface(joined(rectangle(0.1, 0.1, x=-0.5), *scraps), TOWARDS, 1.0)


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((20, 20)), UnsupportedShape, "empty"),
        (np.pad([[0.5]], 10), UnsupportedShape, "no piece"),
        (np.full((20, 30), 0.5), InvalidMesh, "not square"),
        (np.full((20, 20), np.nan), InvalidMesh, "outside"),
    ],
)
def test_bad_images_are_named(image: np.ndarray, error: type[BenchmarkError], message: str) -> None:
    with pytest.raises(error, match=message) as caught:
        back_project(image.astype(np.float32), 1.0)
    assert caught.value.hint

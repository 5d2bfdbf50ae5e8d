"""The depth image and the surface behind it, against shapes whose depth is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from benchmark.errors import BenchmarkError, ConfigurationError, InvalidMesh, UnsupportedShape
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.depth import (
    FEWEST_PIXELS,
    LARGEST_LOSS,
    back_project,
    common_half_width,
    depth_surface,
    render_depth,
)
from benchmark.geometry.mesh import Mesh
from tests.geometry.surfaces import joined, sphere

TOWARDS = Camera((0.0, 0.0, -1.0), up=(0.0, 1.0, 0.0))
"""Camera coordinates are the coordinates of the shape."""


def rectangle(width: float, height: float, z: float = 0.0, x: float = 0.0) -> Mesh:
    corners = [(x - width / 2, -height / 2, z), (x + width / 2, -height / 2, z)]
    corners += [(x + width / 2, height / 2, z), (x - width / 2, height / 2, z)]
    return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))


def ball(radius: float) -> Mesh:
    return sphere(5).with_vertices(radius * sphere(5).vertices)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (float("nan"), 0.0, 0.0)])
def test_no_camera_without_a_direction(direction: tuple[float, float, float]) -> None:
    with pytest.raises(ConfigurationError, match="parallel"):
        Camera(direction)


def test_a_sphere_has_its_analytic_depth() -> None:
    image = render_depth(ball(0.8), FRONT, half_width=1.0)
    y, x = np.meshgrid((np.arange(500) + 0.5) / 250 - 1, (np.arange(500) + 0.5) / 250 - 1, indexing="ij")
    inside = x**2 + y**2 < 0.7**2
    expected = (1 + np.sqrt(0.64 - x**2 - y**2, where=inside, out=np.zeros_like(x))) / 2
    assert image.dtype == np.float32
    assert np.abs(image - expected)[inside].max() < 2e-3
    assert not image[x**2 + y**2 > 0.8**2].any()


def test_a_shape_beyond_the_frame_is_an_error_that_names_the_half_width() -> None:
    with pytest.raises(UnsupportedShape, match=r"half width of at least 1\.11111"):
        render_depth(rectangle(2.0, 1.0), TOWARDS, 1.0)
    deep = joined(rectangle(0.1, 0.1, z=-3), rectangle(0.1, 0.1, z=3))
    with pytest.raises(UnsupportedShape, match="extends to"):
        render_depth(deep, TOWARDS, 1.0)


@pytest.mark.parametrize("odd", [[1e5], [6.0], [1e-5], [1e100, 1e99], [5.1, 1e-90]])
def test_shapes_out_of_scale_have_no_say_in_the_common_frame(odd: list[float]) -> None:
    usual = [0.8, 1.0, 1.0, 1.2]
    assert common_half_width(usual + odd) == 1.2
    assert common_half_width(odd + usual) == 1.2


def test_a_shape_of_a_few_pixels_is_refused() -> None:
    wide = math.sqrt(FEWEST_PIXELS) / 250  # side of a square of as many pixels
    assert depth_surface(rectangle(wide * 1.1, wide * 1.1), TOWARDS, 1.0).report.foreground >= FEWEST_PIXELS
    with pytest.raises(UnsupportedShape, match="pixels of the shape, fewer than 200; check its unit"):
        depth_surface(rectangle(wide * 0.9, wide * 0.9), TOWARDS, 1.0)
    with pytest.raises(UnsupportedShape, match="sees 0 pixels"):
        depth_surface(rectangle(1e-9, 1e-9), TOWARDS, 1.0)


def test_a_view_of_scraps_is_refused_and_a_few_scraps_are_noted() -> None:
    # Sheets of 3 x 3 pixels, four pixels apart: at a stride of one each gives a speck of at most nine samples.
    def scraps(count: int) -> Mesh:
        at = np.stack(np.divmod(np.arange(count), 20), axis=1) * 4 / 250
        return joined(*(Mesh(scrap.vertices + np.append(place, 0), scrap.faces) for place in at))

    scrap = rectangle(2.2 / 250, 2.2 / 250)
    with pytest.raises(UnsupportedShape, match="100% of what the camera sees|hold no piece"):
        depth_surface(scraps(400), TOWARDS, 1.0)
    sheet = rectangle(0.4, 0.4, x=-0.5)
    report = depth_surface(joined(sheet, scraps(40)), TOWARDS, 1.0).report
    assert 0 < report.lost_area < LARGEST_LOSS
    with pytest.raises(UnsupportedShape, match="% of what the camera sees belongs to no piece of 8 samples"):
        depth_surface(joined(rectangle(0.1, 0.1, x=-0.5), scraps(400)), TOWARDS, 1.0)


def test_back_projection_inverts_the_rendering() -> None:
    half_width = 3.0
    surface, report = back_project(render_depth(ball(2.5), FRONT, half_width), half_width)
    radii = np.linalg.norm(surface.vertices, axis=1)
    assert np.abs(radii - 2.5).max() < 5e-3
    assert surface.vertices[:, 2].min() >= 0
    assert report.pieces == 1
    assert report.bridges == report.specks == 0
    assert report.foreground == pytest.approx(np.pi * (250 * 2.5 / 3) ** 2, rel=0.002)
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert ((normals * (a + b + c)).sum(axis=1) > 0).mean() > 0.99


def test_back_projection_of_a_tilted_plane_is_exact_at_every_vertex() -> None:
    mesh = rectangle(1.0, 1.0)
    mesh = mesh.with_vertices(mesh.vertices @ np.array([[1, 0, 0.5], [0, 1, -0.25], [0, 0, 1]]))
    view = depth_surface(mesh, TOWARDS, 0.7)
    x, y, z = view.surface.vertices.T
    np.testing.assert_allclose(z, 0.5 * x - 0.25 * y, atol=2e-6)
    assert view.surface.area == pytest.approx(mesh.area, rel=0.03)


def test_edges_across_a_jump_are_cut_and_bridged() -> None:
    # 0.02 in depth is 0.04 of the half width: below the default jump; 0.03 is 0.06: above it.
    for step, pieces in [(0.02, 1), (0.03, 2)]:
        image = np.full((40, 40), 0.4, dtype=np.float32)
        image[:, 20:] += step
        surface, report = back_project(image, 1.0, stride=4)
        assert report.pieces == pieces
        assert report.bridges >= pieces - 1
        assert (report.bridges == 0) == (pieces == 1)
        assert surface.n_vertices >= 100
        assert len(trimesh.Trimesh(surface.vertices, surface.faces, process=False).split(only_watertight=False)) == 1
    _, report = back_project(image, 1.0, stride=4, jump=0.07)
    assert report.pieces == 1


def test_rounding_errors_choose_no_diagonal() -> None:
    # In a plane that both diagonals climb equally, each block is a tie.
    tie = np.add.outer(np.zeros(40), np.linspace(0.4, 0.6, 40)).astype(np.float32)
    surface, _ = back_project(tie, 1.0, stride=4)
    noise = np.random.default_rng(0).uniform(-1.2e-7, 1.2e-7, tie.shape)
    noisy, _ = back_project((tie + noise).astype(np.float32), 1.0, stride=4)
    assert not np.array_equal(surface.vertices, noisy.vertices)
    np.testing.assert_array_equal(surface.faces, noisy.faces)


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((20, 20)), UnsupportedShape, "empty"),
        (np.zeros((0, 0)), UnsupportedShape, "empty"),
        (np.pad([[0.5]], 10), UnsupportedShape, "no piece"),
        (np.full((20, 30), 0.5), InvalidMesh, "not square"),
        (np.full((20, 20, 1), 0.5), InvalidMesh, "not square"),
        (np.full((20, 20), np.nan), InvalidMesh, "NaN"),
        (np.full((20, 20), 128.0), InvalidMesh, "outside"),
        (np.full((20, 20), -0.1), InvalidMesh, "outside"),
    ],
)
def test_bad_images_are_named(image: np.ndarray, error: type[BenchmarkError], message: str) -> None:
    with pytest.raises(error, match=message) as caught:
        back_project(image.astype(np.float32), 1.0)
    assert caught.value.hint

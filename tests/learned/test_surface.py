"""Surfaces behind predicted images: one piece, closed if there are two sides, whatever the images
hold.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.geometry.mesh import Mesh, edges_of
from learned.surface import closed_surface, open_surface
from tests.learned.toy import Image, ellipsoid


def both(width: float, height: float, x: float = 0.0, y: float = 0.0) -> tuple[Image, Image]:
    """Front and back of an ellipsoid whose depth is as large as its width."""
    front, back = (
        ellipsoid(width, height, x=x, y=y, thickness=side * width / 2) for side in (1, -1)
    )
    return front, back


def is_closed(surface: Mesh) -> bool:
    solid = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    return bool(solid.is_watertight and solid.is_winding_consistent)


def test_an_ellipsoid_comes_back() -> None:
    surface, notes = closed_surface(*both(0.6, 0.8))
    assert is_closed(surface)
    assert surface.area == pytest.approx(1)
    assert 1500 < surface.n_vertices < 2500
    assert notes["predicted_pieces"] == 1
    solid = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert solid.euler_number == 2
    truth = trimesh.creation.icosphere(subdivisions=4)
    truth.apply_scale([0.6, 0.8, 0.6])
    # Volume over area to the power of 3/2 knows no scale; the rim is cut to the pixel.
    assert solid.volume == pytest.approx(truth.volume / truth.area**1.5, rel=0.03)


def test_sides_that_cross_and_pieces_that_are_apart_still_close() -> None:
    front, back = both(0.3, 0.3, -0.4, 0.0)
    other = both(0.25, 0.5, 0.5, 0.1)
    front, back = np.maximum(front, other[0]), np.maximum(back, other[1])
    noise = np.random.default_rng(0).uniform(-0.3, 0.3, front.shape)
    torn = np.where(front > 0, np.clip(back + noise, 1e-3, 1), 0).astype(np.float32)
    surface, notes = closed_surface(front, torn)
    assert is_closed(surface)
    assert np.isfinite(surface.vertices).all()
    assert notes["predicted_pieces"] == 2
    assert float(notes["predicted_crossings"]) > 0.05


def test_noise_does_not_tear_a_predicted_surface() -> None:
    # A grain of a tenth of the half width to either side, twice what cuts the view input.
    grain = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 500))
    whole, notes = open_surface(np.where(ellipsoid() > 0, 0.5 + grain, 0).astype(np.float32))
    assert (notes["predicted_pieces"], notes["predicted_bridges"]) == (1, 0)
    # Nothing is missing beside the disc without the grain, whose only boundary is its outline.
    flat, _ = open_surface(np.where(ellipsoid() > 0, np.float32(0.5), np.float32(0)))
    assert (whole.n_vertices, whole.n_faces) == (flat.n_vertices, flat.n_faces)
    assert np.count_nonzero(edges_of(whole.faces).counts == 1) == np.count_nonzero(
        edges_of(flat.faces).counts == 1
    )

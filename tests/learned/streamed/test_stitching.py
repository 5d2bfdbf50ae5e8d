"""Front and back become one closed surface, whatever the images hold."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.errors import UnsupportedShape
from learned.streamed.model import closed_surface
from tests.learned.streamed.toy import both


def is_closed(surface) -> bool:
    solid = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    return bool(solid.is_watertight and solid.is_winding_consistent)


def test_an_ellipsoid_comes_back() -> None:
    front, back = both(500, 0.6, 0.8)
    surface, notes = closed_surface(front, back)
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
    front, back = both(500, 0.3, 0.3, -0.4, 0.0)
    other = both(500, 0.25, 0.5, 0.5, 0.1)
    front, back = np.maximum(front, other[0]), np.maximum(back, other[1])
    noise = np.random.default_rng(0).uniform(-0.3, 0.3, front.shape)
    torn = np.where(front > 0, np.clip(back + noise, 1e-3, 1), 0).astype(np.float32)
    surface, notes = closed_surface(front, torn)
    assert is_closed(surface)
    assert np.isfinite(surface.vertices).all()
    assert notes["predicted_pieces"] == 2
    assert notes["predicted_crossings"] > 0.05


def test_an_empty_mask_is_refused() -> None:
    nothing = np.zeros((500, 500), dtype=np.float32)
    with pytest.raises(UnsupportedShape, match="empty mask"):
        closed_surface(nothing, nothing)

"""The crop makes a network blind to the frame, and to nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from learned.streamed.crop import FILL, cropped
from tests.learned.streamed.toy import both

RESOLUTION = 32


@pytest.mark.parametrize(("scale", "x", "y"), [(0.5, 0.0, 0.0), (0.7, 0.2, -0.25), (0.9, -0.05, 0.05)])
def test_size_and_place_in_the_frame_are_lost(scale: float, x: float, y: float) -> None:
    whole = cropped(both(512, 0.4, 1.0)[0][None], RESOLUTION)
    other = cropped(both(512, scale * 0.4, scale, x, y)[0][None], RESOLUTION)
    assert np.mean((whole > 0) != (other > 0)) < 0.02
    inside = (whole > 0) & (other > 0)
    np.testing.assert_allclose(whole[inside], other[inside], atol=0.02)


def test_depth_is_scaled_like_lengths() -> None:
    # A plane at 45 degrees stays one: depth rises by a hundredth of the frame for each of its hundred columns.
    size = 400
    plane = np.zeros((1, size, size), dtype=np.float32)
    columns = np.arange(100, 200)
    plane[0, 100:200, 100:200] = 0.4 + (columns - 150) / size
    result = cropped(plane, 100)[0]
    row = result[50][result[50] > 0]
    assert len(row) == 90
    assert np.ptp(row) == pytest.approx(89 / 100, rel=0.01)
    assert np.diff(row).min() > 0
    assert row.mean() == pytest.approx(0.5, abs=0.005)


def test_front_and_back_share_one_frame() -> None:
    result = cropped(np.stack(both(400, 0.2, 0.5, 0.3, 0.1)), 64)
    inside = result[0] > 0
    np.testing.assert_array_equal(inside, result[1] > 0)
    assert (result[0][inside] >= result[1][inside]).all()
    # Half the width of the ellipsoid is its thickness on either side, and its height fills the frame.
    assert (result[0] - result[1]).max() == pytest.approx(0.5 * 0.2 * 2 / 0.5 * FILL / 1 * 0.5 * 2, rel=0.05)

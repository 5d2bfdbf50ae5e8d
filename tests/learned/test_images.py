"""Depth images at other resolutions: what is background stays so, and no depth is mixed with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmark.api.learning import TrainingPair
from benchmark.errors import InvalidMesh
from benchmark.geometry.depth import SIZE
from learned.images import checked_image, enlarge, shrink, smooth
from learned.paired.pairs import gather
from tests.learned.toy import Image, ellipsoid, person


def disc(depth: float = 0.7) -> Image:
    return np.where(ellipsoid() > 0, np.float32(depth), np.float32(0))


def enlarged(image: Image, resolution: int) -> Image:
    return enlarge(torch.from_numpy(shrink(image, resolution)))


@pytest.mark.parametrize("resolution", [32, 250])
def test_a_constant_depth_stays_to_the_rim(resolution: int) -> None:
    depth, mask = shrink(disc(), resolution)
    assert set(np.unique(mask)) == {0, 1}
    np.testing.assert_allclose(depth[mask > 0], 0.7, rtol=1e-5)
    assert not depth[mask == 0].any()


def test_a_coarse_pixel_is_covered_from_one_half_on_and_has_the_mean_of_what_it_sees() -> None:
    image = np.zeros((SIZE, SIZE), dtype=np.float32)
    image[0, 0] = 0.9  # one of four
    image[0, 2], image[1, 3] = 0.25, 0.75  # two of four
    image[2:4, 0:2] = [[0.25, 0.5], [0.75, 0.0]]  # three of four
    depth, mask = shrink(image, SIZE // 2)
    np.testing.assert_array_equal(mask[:2, :2], [[0, 1], [1, 0]])
    np.testing.assert_array_equal(depth[:2, :2], [[0, 0.5], [0.5, 0]])


@pytest.mark.parametrize(("resolution", "overlap", "error"), [(128, 0.96, 0.01), (250, 0.97, 0.005)])
def test_enlarging_undoes_shrinking(resolution: int, overlap: float, error: float) -> None:
    image = person()
    again = enlarged(image, resolution)
    both, either = (image > 0) & (again > 0), (image > 0) | (again > 0)
    assert again.shape == (SIZE, SIZE)
    assert both.sum() / either.sum() > overlap
    assert np.median(np.abs(again - image)[both]) < error / 5
    assert np.mean(np.abs(again - image)[both]) < error


@pytest.mark.parametrize("resolution", [32, 128])
def test_the_rim_does_not_fall_towards_the_background(resolution: int) -> None:
    again = enlarged(disc(), resolution)
    np.testing.assert_allclose(again[again > 0], 0.7, rtol=1e-5)
    assert np.mean((again > 0) == (disc() > 0)) > 0.98


def test_a_seen_pixel_is_never_background() -> None:
    # A sigmoid may come arbitrarily near to the depth of the background.
    prediction = torch.stack([torch.zeros(32, 32), torch.ones(32, 32)])
    assert enlarge(prediction).min() > 0


@pytest.mark.parametrize("shape", [(128, 128), (500, 500, 1)])
def test_another_size_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidMesh, match="render 500 x 500 pixels"):
        checked_image(np.full(shape, 0.5, dtype=np.float32))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.5, -0.1])
def test_a_value_that_is_no_depth_is_refused(value: float) -> None:
    image = person()
    image[250, 250] = value
    with pytest.raises(InvalidMesh, match=r"NaN or values outside \[0, 1\]"):
        checked_image(image)


def pair(identifier: str, target_identifier: str, image: Image, target: Image) -> TrainingPair:
    return TrainingPair(
        identifier=identifier, subject="x", target_identifier=target_identifier, image=image, target=target
    )


def test_each_distinct_target_is_kept_once() -> None:
    first, second, third = ellipsoid(0.3, 0.6), ellipsoid(0.6, 0.3), person()
    found = gather(
        [pair("a", "t", third, first), pair("b", "u", first, second), pair("c", "t", second, first)], resolution=64
    )
    assert len(found) == 3
    assert found.identifiers == ("a", "b", "c")
    assert found.target_of.tolist() == [0, 1, 0]
    assert (found.images.shape, found.targets.shape) == ((3, 1, 64, 64), (2, 2, 64, 64))
    np.testing.assert_array_equal(found.images[0, 0], shrink(third, 64)[0])
    np.testing.assert_array_equal(found.targets[1], shrink(second, 64))


def test_nan_in_a_pair_is_found_before_training() -> None:
    broken = person()
    broken[0, 0] = np.nan
    for image, target in ((broken, person()), (person(), broken)):
        with pytest.raises(InvalidMesh, match="NaN"):
            gather([pair("a", "a", person(), person()), pair("b", "b", image, target)], resolution=32)


def test_smoothing_takes_noise_away_and_keeps_the_mask_and_a_slope() -> None:
    across = torch.linspace(0.2, 0.8, 64).expand(64, 64)
    mask = torch.zeros(64, 64)
    mask[16:48, 16:48] = 1
    noise = 0.05 * torch.randn(64, 64, generator=torch.Generator().manual_seed(0))
    smoothed = smooth(torch.stack([across + noise, mask]), 2.0)
    np.testing.assert_array_equal(smoothed[1], mask)
    centre = slice(24, 40)
    # The mean of 4 pi deviation^2 independent values has a standard deviation smaller by the root of that number.
    rest = (smoothed[0] - across)[centre, centre]
    assert float(rest.std()) < 1.3 * 0.05 / (4 * np.pi * 4) ** 0.5

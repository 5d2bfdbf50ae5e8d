"""Depth images at other resolutions: what is background stays so, and no depth is mixed with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmark.api.learning import TrainingPair
from benchmark.errors import InvalidMesh, UnsupportedShape
from benchmark.geometry.depth import SIZE
from learned.images import (
    DepthScale,
    checked_image,
    enlarged,
    outline_blur,
    resampled,
)
from learned.pairs import gather
from tests.learned.toy import Image, ellipsoid, person


@pytest.mark.parametrize("value", [np.nan, 1.5, -0.1])
def test_another_size_and_a_value_that_is_no_depth_are_refused(value: float) -> None:
    for image, said in (
        (person(), r"NaN or values outside \[0, 1\]"),
        (person()[::4, ::4], "render 500 x 500 pixels"),
    ):
        image[100, 100] = value
        with pytest.raises(InvalidMesh, match=said):
            checked_image(image)
    assert checked_image(np.ones((500, 500), np.float32)).max() == 1


@pytest.mark.parametrize("resolution", [125, 128, 333])
def test_a_coarse_pixel_has_the_mean_depth_of_what_it_covers(resolution: int) -> None:
    flat = np.where(ellipsoid() > 0, np.float32(0.7), np.float32(0))
    depth, mask = resampled(flat, resolution)
    assert set(np.unique(mask)) == {0, 1}
    assert (depth > 0).tolist() == (mask > 0).tolist()
    np.testing.assert_allclose(depth[mask > 0], 0.7, atol=1e-6)
    assert mask.mean() == pytest.approx((flat > 0).mean(), abs=0.01)
    fine = resampled(person(), SIZE)
    np.testing.assert_array_equal(fine[0], person())


def test_a_cropped_image_shows_neither_size_nor_place() -> None:
    v, u = np.mgrid[:SIZE, :SIZE].astype(float)

    def dome(radius: int, row: int, column: int) -> Image:
        relief = np.clip(1 - ((v - row) ** 2 + (u - column) ** 2) / radius**2, 0, None)
        depth = 0.5 - np.sqrt(relief) * radius / SIZE
        return np.where(relief > 0, depth, 0).astype(np.float32)

    places = (60, 100, 300), (180, 250, 250)
    small, large = (resampled(dome(*place), 32, crop=True) for place in places)
    assert not np.array_equal(*(resampled(dome(*place), 32) for place in places))
    assert (small[1] == large[1]).mean() > 0.97
    both = (small[1] > 0) & (large[1] > 0)
    assert np.abs(small[0] - large[0])[both].mean() < 0.02


def test_a_seen_pixel_is_never_background() -> None:
    # A sigmoid may come arbitrarily near to the depth of the background.
    prediction = torch.stack([torch.zeros(32, 32), torch.ones(32, 32)])
    assert enlarged(prediction).min() > 0


def test_the_blur_of_an_outline_is_its_width_in_pixels() -> None:
    ramp = torch.tensor([0.0, 0.25, 0.75, 1.0]).repeat(5, 1)
    assert outline_blur(ramp) == 1.5
    assert outline_blur(ramp.round()) == outline_blur(ramp * 0) == 0.0


def pair(identifier: str, target_identifier: str, image: Image, target: Image) -> TrainingPair:
    return TrainingPair(
        identifier=identifier,
        subject="x",
        target_identifier=target_identifier,
        image=image,
        target=target,
    )


def test_each_distinct_target_is_kept_once() -> None:
    first, second, third = ellipsoid(0.3, 0.6), ellipsoid(0.6, 0.3), person()
    given = [
        pair("a", "t", third, first),
        pair("b", "u", first, second),
        pair("c", "t", second, first),
    ]
    pairs = gather(given, 4, 64)  # of four pairs, one could not be rendered
    assert (pairs.names, pairs.target_of.tolist()) == (("a", "b", "c"), [0, 1, 0])
    assert (pairs.images.shape, pairs.targets.shape) == ((3, 1, 64, 64), (2, 2, 64, 64))
    image, target = pairs[torch.tensor([2])]
    np.testing.assert_array_equal(image[0, 0], resampled(second, 64)[0])
    np.testing.assert_array_equal(target[0], resampled(first, 64))
    other = gather([*given[:2], pair("c", "t", person(), first)], 3, 64)
    assert pairs.digest() != other.digest()
    assert pairs.digest() == gather(given, 3, 64).digest()


@pytest.mark.parametrize("crop", [False, True])
def test_an_object_that_is_too_thin_for_the_pixels_is_refused(crop: bool) -> None:
    wire = np.zeros((SIZE, SIZE), dtype=np.float32)
    wire[50:450, 250] = 0.5
    assert resampled(wire, SIZE)[1].sum() == 400
    with pytest.raises(UnsupportedShape, match="too thin or too small for 64 x 64 pixels; take a"):
        resampled(wire, 64, crop=crop)
    for image, target in ((wire, person()), (person(), wire)):
        with pytest.raises(UnsupportedShape, match="^b: the object is too thin"):
            gather([pair("a", "a", person(), person()), pair("b", "b", image, target)], 2, 64)


def test_nan_in_a_pair_is_found_before_training() -> None:
    broken = person()
    broken[0, 0] = np.nan
    for image, target in ((broken, person()), (person(), broken)):
        with pytest.raises(InvalidMesh, match="^b: .*NaN"):
            gather([pair("a", "a", person(), person()), pair("b", "b", image, target)], 2, 32)


def test_depths_of_targets_fill_their_range_and_come_back() -> None:
    depth = torch.tensor([[[0.0, 0.48], [0.5, 0.52]], [[0.0, 0.54], [0.5, 0.52]]])
    targets = torch.stack([depth, (depth > 0).float()], dim=1)
    scale = DepthScale.of(targets)
    assert (scale.mean, scale.factor) == (pytest.approx(3.06 / 6), pytest.approx(0.4 / 0.03))
    below, above = 0.5 - 0.4 / 3, 0.5 + 0.4 / 3
    scaled = scale.apply(targets)
    torch.testing.assert_close(
        scaled[:, 0], torch.tensor([[[0.0, 0.1], [below, above]], [[0.0, 0.9], [below, above]]])
    )
    assert torch.equal(scaled[:, 1], targets[:, 1])
    torch.testing.assert_close(scale.undo(scaled[1])[0][targets[1, 1] > 0], depth[1][depth[1] > 0])
    two_sides = torch.rand(3, 9, 9, dtype=torch.float64) ** 9
    assert torch.equal(DepthScale().undo(two_sides), two_sides)

"""Depth images at other resolutions: what is background stays so, and no depth is mixed with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmark.api.learning import TrainingPair
from benchmark.errors import InvalidMesh
from learned.images import checked_image, enlarge, outline_blur, shrink
from learned.paired.pairs import gather
from tests.learned.toy import Image, ellipsoid, person


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


def test_the_blur_of_an_outline_is_its_width_in_pixels() -> None:
    ramp = torch.tensor([0.0, 0.25, 0.75, 1.0]).repeat(5, 1)
    assert outline_blur(ramp) == 1.5
    assert outline_blur(ramp.round()) == outline_blur(ramp * 0) == 0.0


def pair(identifier: str, target_identifier: str, image: Image, target: Image) -> TrainingPair:
    return TrainingPair(
        identifier=identifier, subject="x", target_identifier=target_identifier, image=image, target=target
    )


def test_each_distinct_target_is_kept_once() -> None:
    first, second, third = ellipsoid(0.3, 0.6), ellipsoid(0.6, 0.3), person()
    pairs = gather(
        [pair("a", "t", third, first), pair("b", "u", first, second), pair("c", "t", second, first)], resolution=64
    )
    assert len(pairs) == 3
    assert pairs.identifiers == ("a", "b", "c")
    assert pairs.target_of.tolist() == [0, 1, 0]
    assert (pairs.images.shape, pairs.targets.shape) == ((3, 1, 64, 64), (2, 2, 64, 64))
    np.testing.assert_array_equal(pairs.images[0, 0], shrink(third, 64)[0])
    np.testing.assert_array_equal(pairs.targets[1], shrink(second, 64))


def test_nan_in_a_pair_is_found_before_training() -> None:
    broken = person()
    broken[0, 0] = np.nan
    for image, target in ((broken, person()), (person(), broken)):
        with pytest.raises(InvalidMesh, match="NaN"):
            gather([pair("a", "a", person(), person()), pair("b", "b", image, target)], resolution=32)

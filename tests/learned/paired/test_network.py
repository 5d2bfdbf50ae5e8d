"""Sizes, layers and receptive fields of the networks, against what the paper prints and what follows by hand."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from learned.paired.configuration import CONFIGURATIONS, LITERAL, configuration
from learned.paired.network import SameSizeDeconvolution, build

PROGRESSIVE = [name for name, each in CONFIGURATIONS.items() if each.architecture == "progressive"]


@pytest.fixture
def no_gradient() -> Iterator[None]:
    """Keep nothing for a backward pass."""
    with torch.no_grad():
        yield


#: Both parts that follow see one channel less: nine numbers for each of 16 and of 32 channels.
LESS_TO_LONG, LESS_TO_RECONSTRUCTION = 9 * 16, 9 * 32


def images(count: int, height: int, width: int, seed: int = 0) -> Tensor:
    return torch.rand(count, 1, height, width, generator=torch.Generator().manual_seed(seed))


def is_mask(values: Tensor) -> bool:
    return bool(values.min() > 0 and values.max() < 1)


@pytest.mark.usefixtures("no_gradient")
@pytest.mark.parametrize("name", PROGRESSIVE)
@pytest.mark.parametrize(("height", "width"), [(128, 128), (125, 125), (63, 63), (125, 63), (32, 33)])
def test_any_size_comes_out_as_it_went_in(name: str, height: int, width: int) -> None:
    output = build(configuration(name))(images(2, height, width))
    assert output.shape == (2, 2, height, width)
    assert is_mask(output[:, 1])


@pytest.mark.usefixtures("no_gradient")
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_an_image_does_not_depend_on_its_batch(name: str) -> None:
    network = build(configuration(name)).eval()
    batch = images(3, 128, 128)
    torch.testing.assert_close(network(batch)[1:2], network(batch[1:2]), atol=1e-5, rtol=1e-5)


def test_weights_depend_on_the_seed_alone() -> None:
    first, other = build(LITERAL, 3).state_dict(), build(LITERAL, 4).state_dict()
    torch.manual_seed(11)
    before = torch.random.get_rng_state()
    again = build(LITERAL, 3).state_dict()
    assert torch.equal(torch.random.get_rng_state(), before)
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not torch.equal(first["short_range.0.0.weight"], other["short_range.0.0.weight"])


@pytest.mark.parametrize(("channels_out", "dilation"), [(3, 1), (1, 1), (3, 4)])
def test_a_deconvolution_of_the_same_size_is_the_one_of_torch(channels_out: int, dilation: int) -> None:
    ours = SameSizeDeconvolution(2, channels_out, 3, padding=dilation, dilation=dilation).double()
    image = torch.rand(2, 2, 20, 17, dtype=torch.float64, requires_grad=True)
    theirs = functional.conv_transpose2d(image, ours.weight, ours.bias, padding=dilation, dilation=dilation)
    torch.testing.assert_close(ours(image), theirs, rtol=0, atol=1e-12)
    towards = torch.rand_like(theirs)
    wanted = (image, ours.weight, ours.bias)
    found, expected = (torch.autograd.grad(result, wanted, towards) for result in (ours(image), theirs))
    for mine, other in zip(found, expected, strict=True):
        torch.testing.assert_close(mine, other, rtol=0, atol=1e-10)

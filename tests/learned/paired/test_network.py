"""Sizes, layers and receptive fields of the networks, against what the paper prints and what follows by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.paired.configuration import CONFIGURATIONS, LITERAL, configuration
from learned.paired.network import (
    LongRangeFeatures,
    SameSizeDeconvolution,
    build,
)
from learned.weights import n_parameters

#: Maxima of a pool depend on the input, so receptive fields are the union over some of them.
N_INPUTS = 3

PROGRESSIVE = [name for name, each in CONFIGURATIONS.items() if each.architecture == "progressive"]


@pytest.fixture
def no_gradient() -> Iterator[None]:
    """Keep nothing for a backward pass."""
    with torch.no_grad():
        yield


def weights(before: int, after: int, kernel: int = 3) -> int:
    """Numbers of one convolution, transposed or not: a kernel for each pair of channels, and a bias."""
    return before * after * kernel**2 + after


SHORT = weights(1, 16) + 7 * weights(16, 16) + weights(16, 1)
LONG = weights(2, 16) + 8 * weights(16, 16) + weights(16, 1)
ENCODER = weights(3, 32) + weights(32, 64) + weights(64, 128) + weights(128, 256)
DECODER = weights(256, 128, 4) + weights(128, 64, 4) + weights(64, 32, 4) + weights(32, 32, 4)
HEAD = weights(32, 2, 1)
#: Both parts that follow see one channel less: nine numbers for each of 16 and of 32 channels.
LESS_TO_LONG, LESS_TO_RECONSTRUCTION = 9 * 16, 9 * 32
#: The innermost features have 8 * 16 channels and 4 x 4 pixels; the vector has 256 numbers.
CODE = 128 * 4**2
WIDE_EXTRA = (
    (weights(1, 16, 4) + weights(16, 32, 4) + weights(32, 64, 4) + weights(64, 128, 4) + weights(128, 128, 4))
    + (weights(128, 128, 4) + weights(128, 64, 4) + weights(64, 32, 4) + weights(32, 16, 4) + weights(16, 16, 4))
    + 2 * (16 + 32 + 64 + 128 + 128)
    + 2 * (128 + 64 + 32 + 16 + 16)
    + (CODE * 256 + 256)
    + (256 * CODE + CODE)
    + weights(16, 2)
)
PARAMETERS = {
    "literal": (SHORT + LONG + ENCODER + DECODER + HEAD, 1_128_804),
    "without_srf": (LONG - LESS_TO_LONG + ENCODER + DECODER + HEAD - LESS_TO_RECONSTRUCTION, 1_111_827),
    "without_lrf": (SHORT + ENCODER + DECODER + HEAD - LESS_TO_RECONSTRUCTION, 1_109_507),
    "wide-extra": (WIDE_EXTRA, 1_925_746),
}


def seeded(part: Callable[..., nn.Module], *arguments: Any) -> nn.Module:
    """A part of a network whose weights are the same in every run."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return part(*arguments)


def convolutions(network: nn.Module) -> list[nn.Module]:
    return [layer for layer in network.modules() if isinstance(layer, (nn.Conv2d, nn.ConvTranspose2d))]


def images(count: int, height: int, width: int, seed: int = 0) -> Tensor:
    return torch.rand(count, 1, height, width, generator=torch.Generator().manual_seed(seed))


def field_of(network: nn.Module, size: int, pixel: int) -> tuple[int, int]:
    """Rows and columns of the input that one output pixel on the diagonal depends on, over several random inputs."""
    seen = torch.zeros(size, size, dtype=torch.bool)
    for seed in range(N_INPUTS):
        image = torch.rand(1, 1, size, size, generator=torch.Generator().manual_seed(seed)).requires_grad_()
        network(image)[0, :, pixel, pixel].sum().backward()
        seen |= (image.grad[0] != 0).any(dim=0)
    rows, columns = seen.any(dim=1).nonzero(), seen.any(dim=0).nonzero()
    return int(rows.max() - rows.min()) + 1, int(columns.max() - columns.min()) + 1


def is_mask(values: Tensor) -> bool:
    return bool(values.min() > 0 and values.max() < 1)


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_number_of_parameters(name: str) -> None:
    by_hand, golden = PARAMETERS[name]
    assert by_hand == golden
    assert n_parameters(build(configuration(name))) == golden


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


def test_short_range_features_see_19_pixels() -> None:
    # Nine kernels of three: 1 + 9 * 2.
    assert field_of(build(LITERAL).short_range, size=41, pixel=20) == (19, 19)


def test_long_range_features_see_81_pixels() -> None:
    # 1 + 2 (2 + 3 + 4 + 5 + 6) = 41, and 40 more with the transposed convolutions.
    assert field_of(seeded(LongRangeFeatures, 1, 4), size=101, pixel=50) == (81, 81)


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

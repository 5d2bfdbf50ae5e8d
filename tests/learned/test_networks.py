"""Sizes and layers of the networks, against what the paper prints and what follows by hand."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from learned.code_network import CodeNetwork
from learned.paper_network import MASK_LOGIT, PaperNetwork


def images(count: int, height: int, width: int) -> Tensor:
    return torch.rand(count, 1, height, width, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("parts", [(True, True), (False, True), (True, False)])
@pytest.mark.parametrize(("height", "width"), [(128, 128), (63, 63), (125, 63), (32, 33)])
def test_any_size_comes_out_as_it_went_in(
    parts: tuple[bool, bool], height: int, width: int
) -> None:
    with torch.no_grad():
        output = PaperNetwork(16, *parts)(images(2, height, width))
    assert output.shape == (2, 2, height, width)
    # At first, the mask is about the share of the frame that a shape covers; the depth is no
    # probability.
    assert float(output[:, 1].mean()) == pytest.approx(1 / (1 + math.exp(-MASK_LOGIT)), abs=0.05)
    assert output[:, 0].min() < 0


def test_weights_depend_on_the_seed_alone() -> None:
    first, other = PaperNetwork(seed=3).state_dict(), PaperNetwork(seed=4).state_dict()
    torch.manual_seed(11)
    before = torch.random.get_rng_state()
    again = PaperNetwork(seed=3).state_dict()
    assert torch.equal(torch.random.get_rng_state(), before)
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not torch.equal(first["short_range.0.0.weight"], other["short_range.0.0.weight"])


def test_weights_of_the_global_code_depend_on_the_seed_alone() -> None:
    first, other = CodeNetwork(seed=3).state_dict(), CodeNetwork(seed=4).state_dict()
    torch.manual_seed(11)
    again = CodeNetwork(seed=3).state_dict()
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not torch.equal(first["encoder.0.0.weight"], other["encoder.0.0.weight"])
    assert first["head.bias"].tolist() == [0, MASK_LOGIT]


def test_a_pixel_of_the_output_sees_160_to_176_pixels_across(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "torch.nn.functional.max_pool2d", torch.nn.functional.avg_pool2d
    )  # all pixels of a block count
    network = PaperNetwork(4).double()
    for parameter in network.parameters():
        parameter.data.abs_()  # no two paths cancel
    for row, across in ((126, 176), (127, 160)):
        image = images(1, 256, 256).double().requires_grad_()
        network(image)[0, 0, row, 128].backward()
        assert image.grad is not None
        assert (image.grad[0, 0] != 0).any(dim=1).sum() == across

"""Every configuration predicts what it says, learns from every weight, and learns a pair by heart."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmark.errors import ConfigurationError
from learned.streamed.configuration import STREAMED, Streamed, from_card, streamed
from learned.streamed.images import batch_of
from learned.streamed.losses import WEIGHTS, code_loss, place_loss, weighted
from learned.streamed.network import build_streamed
from learned.streamed.training import batch_losses
from tests.learned.streamed.toy import Ellipsoids, toy

CHANGES = {
    name: {key: value for key, value in each.described().items() if key not in ("name", "resolution", "code_size")}
    for name, each in STREAMED.items()
}


def small(name: str) -> Streamed:
    """The configuration at a size that costs nothing."""
    return toy(**CHANGES[name] | {"width": 8})


@pytest.mark.parametrize("name", STREAMED)
def test_shapes_and_ranges_of_each_configuration(name: str) -> None:
    chosen = streamed(name)
    with torch.no_grad():
        network = build_streamed(chosen)
        image = torch.rand(2, 1, chosen.resolution, chosen.resolution, generator=torch.Generator().manual_seed(0))
        result = network.eval()(image)
    assert result.shape == (2, chosen.sides + 1, chosen.resolution, chosen.resolution)
    assert 0 < result[:, -1].min() < result[:, -1].max() < 0.5
    assert network.code(image).shape == (2, chosen.code_size)
    assert from_card(chosen.described()) == chosen


@pytest.mark.parametrize("name", STREAMED)
def test_the_gradient_of_every_term_that_counts_reaches_every_weight(name: str) -> None:
    chosen = small(name)
    network = build_streamed(chosen)
    batch = batch_of(Ellipsoids()(0, 4, 64), 0, chosen)
    terms = batch_losses(network, chosen, batch, torch.device("cpu"), half=False)
    counted = [getattr(chosen, name) > 0 for name in WEIGHTS]
    assert [bool(term > 0) for term in terms] == [True, True, *counted]
    weighted(terms, chosen).backward()
    for weight in network.parameters():
        assert weight.grad is not None
        assert weight.grad.abs().max() > 0


def test_places_are_the_means_of_what_a_coarse_pixel_shows() -> None:
    chosen = toy(places=1.0)
    fresh = Ellipsoids()(0, 2, 64)
    assert fresh.pixels is not None
    assert fresh.places is not None
    (rows, columns) = np.nonzero(fresh.images[0, 0])
    fresh.pixels[0, 0] = np.nan
    # Two points in the first pixel that shows something, of which the mean is told.
    fresh.pixels[0, 0, 3:5] = [rows[0] + 0.5, columns[0] + 0.5]
    coarse = batch_of(fresh, 0, chosen).places
    assert coarse is not None
    assert coarse.shape == (4, 4, 4, 4)
    assert coarse[0, 3].sum() == 1
    row, column = np.argwhere(coarse[0, 3].numpy())[0]
    np.testing.assert_allclose(coarse[0, :3, row, column], fresh.places[0, 3:5].mean(axis=0), rtol=1e-5)
    assert place_loss(coarse[:, :3] + 1, coarse) == pytest.approx(3)


def test_one_code_for_all_poses_costs_nothing_however_small_the_codes_are() -> None:
    bodies = torch.randn(6, 1, 5, generator=torch.Generator().manual_seed(0))
    same = bodies.expand(6, 2, 5).reshape(12, 5)
    assert code_loss(same, 2) == pytest.approx(0, abs=1e-6)
    anyhow = torch.randn(400, 5, generator=torch.Generator().manual_seed(1))
    for scale in (1.0, 1e-2):
        assert code_loss(scale * anyhow, 2) == pytest.approx(1, abs=0.15)


def test_a_card_of_another_network_and_a_resolution_that_cannot_be_are_refused() -> None:
    described = streamed("people").described()
    with pytest.raises(ConfigurationError, match="another kind of network"):
        from_card(described | {"depth": 3})
    with pytest.raises(ConfigurationError, match="multiple of 32"):
        from_card(described | {"resolution": 100})
    with pytest.raises(ConfigurationError, match="sides"):
        from_card(described | {"sides": 3})
    with pytest.raises(ConfigurationError, match="did you mean"):
        streamed("peopel")

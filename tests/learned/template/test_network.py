"""Derivatives are those of the fields, and each term of the loss is what its formula says."""

from dataclasses import replace

import numpy as np
import torch

from learned.template.losses import NAMES, losses, weighted
from learned.template.network import TemplateNetwork, build_auto_decoder
from tests.learned.template.toy import TOY

SHEAR, CORRECTION = 0.75, 0.2


def moved(seed: int = 0) -> TemplateNetwork:
    """A network whose deformation is not zero."""
    network = build_auto_decoder(TOY, 1, seed).fields.double()
    with torch.no_grad():
        network.deformation.last.weight.normal_(generator=torch.Generator().manual_seed(seed), std=0.1)
    return network


def test_before_training_nothing_moves() -> None:
    network = build_auto_decoder(TOY, 1, 0).fields
    points, codes = torch.randn(2, 5, 3), torch.randn(2, TOY.code_size)
    places, correction = network.deformed(points, codes)
    assert torch.equal(places[..., 0, :], points)
    assert not correction.any()
    assert torch.equal(network.distances(points, codes), network.template_distances(points)[..., 0, 0])


def test_the_derivatives_that_are_carried_forwards_are_those_of_autograd() -> None:
    network = moved()
    points = torch.randn(2, 4, 3, dtype=torch.float64, requires_grad=True)
    codes = torch.randn(2, TOY.code_size, dtype=torch.float64)
    places, correction = network.deformed(points, codes, derivatives=True)
    field = network.template_distances(places[..., 0, :], derivatives=True)
    for jet in (places, correction):
        for output in range(jet.shape[-1]):
            (slope,) = torch.autograd.grad(jet[..., 0, output].sum(), points, retain_graph=True)
            torch.testing.assert_close(jet[..., 1:, output], slope)
    (slope,) = torch.autograd.grad(network.distances(points, codes).sum(), points)
    whole = (places[..., 1:, :] @ field[..., 1:, :] + correction[..., 1:, :])[..., 0]
    torch.testing.assert_close(whole, slope)


def test_a_code_moves_only_its_own_shape() -> None:
    network, codes = moved(), torch.randn(2, TOY.code_size, dtype=torch.float64)
    points = torch.randn(1, 6, 3, dtype=torch.float64).expand(2, 6, 3)
    both = network.distances(points, codes)
    assert not torch.allclose(both[0], both[1])
    torch.testing.assert_close(network.distances(points[:1], codes[1:])[0], both[1])


class Sheared:
    """The template is the half space x < 0; a shape is sheared into it, x by SHEAR times y, and corrected."""

    def deformed(self, points, codes, *, derivatives):
        jet = torch.cat([points[..., None, :], torch.eye(3).expand(*points.shape, 3)], dim=-2)
        jet = torch.stack([jet[..., 0] + SHEAR * jet[..., 1], jet[..., 1], jet[..., 2]], dim=-1)
        correction = torch.zeros(*points.shape[:-1], 4, 1)
        correction[..., 0, 0] = CORRECTION
        return jet, correction

    def template_distances(self, points, *, derivatives):
        slope = torch.tensor([1.0, 0.0, 0.0]).expand(points.shape)
        return torch.cat([points[..., :1], slope], dim=-1)[..., None]


def test_the_terms_of_a_sheared_half_space_are_those_worked_by_hand() -> None:
    points = torch.tensor([[[0.0, 0, 0], [0, 0, 0.5], [0.1, 0, 0], [0.2, 0.2, 1]]])
    directions = torch.tensor([1.0, 0, 0]).expand(1, 4, 3)
    distances = torch.tensor([[0.0, 0.0, 0.1, 0.8]])
    found = dict(zip(NAMES, losses(Sheared(), torch.full((1, 4), 2.0), points, directions, distances), strict=True))
    # The field is x + .75 y + .2: .2, .2, .3 and .55; beyond .5 nothing counts.
    expected = {
        "distance loss": (0.2 + 0.2 + 0.2 + 0.0) / 4,
        "normal loss": 1 - 1 / 1.25,
        "eikonal loss": 0.25,
        "template normal loss": 0.0,
        "smoothness loss": SHEAR / 3,
        "correction loss": CORRECTION,
        "code loss": 4.0,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(float(found[name]), value, atol=1e-5, err_msg=name)


def test_the_weights_are_those_of_the_configuration() -> None:
    chosen = replace(
        TOY, normal=2.0, eikonal=3.0, template_normal=4.0, smoothness=5.0, correction=6.0, code=7.0
    )  # fmt: skip
    terms = torch.tensor([10.0**power for power in range(7)])
    assert float(weighted(terms, chosen)) == 7654321


def test_gradients_are_finite_where_nothing_moves() -> None:
    network = build_auto_decoder(TOY, 1, 0)
    terms = losses(network.fields, network.codes.weight, torch.randn(1, 8, 3), torch.randn(1, 8, 3), torch.randn(1, 8))
    weighted(terms, TOY).backward()
    assert all(torch.isfinite(each.grad).all() for each in network.parameters() if each.grad is not None)

"""The network answers alike however a shape is given, and can learn."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from scipy.spatial.transform import Rotation

from benchmark.errors import ConfigurationError
from learned.field.batches import MakesSurfaceBatches
from learned.field.configuration import FIELDS, check_sizes, field_named, from_card
from learned.field.network import Unbent, build_field
from learned.field.training import losses, weighted
from tests.learned.field.toy import TOY
from tests.learned.streamed.toy import Ellipsoids


def batch(perturbed=False, number=0, bodies=1):
    return MakesSurfaceBatches(Ellipsoids().surfaces, TOY, bodies, perturbed)(number)


def test_the_order_of_points_and_of_positions_is_of_no_account():
    """But for which points are the tokens, the first ones."""
    sample = batch()
    network = build_field(TOY).eval()
    order = torch.cat([torch.randperm(TOY.tokens), TOY.tokens + torch.randperm(TOY.points - TOY.tokens)])
    asked = torch.randperm(sample.positions.shape[1])
    with torch.no_grad():
        one = network(sample.points, sample.normals, sample.positions, sample.position_normals)
        other = network(
            sample.points[:, order],
            sample.normals[:, order],
            sample.positions[:, asked],
            sample.position_normals[:, asked],
        )
    assert torch.allclose(one.positions[:, asked], other.positions, atol=1e-5)
    assert torch.allclose(one.rotations[:, asked], other.rotations, atol=1e-4)


def test_terms_of_the_loss_by_hand():
    """A quarter turn that is predicted as none, of edges of length 1 that are predicted with length 2."""
    positions = torch.tensor([[[0.0, 0, 0], [1, 0, 0]]])
    turn = torch.tensor(Rotation.from_euler("z", 90, degrees=True).as_matrix()).float()
    targets, normals = positions @ turn.T, torch.tensor([[[1.0, 0, 0], [0, 0, 1]]])
    none = torch.eye(3).expand(1, 2, 3, 3)
    terms = losses(Unbent(2 * positions, none), positions, targets, normals, normals @ turn.T)
    # The end lies at (2, 0, 0), not at (0, 1, 0); edge and first normal are off by the root of 2, the second is right.
    assert terms.tolist() == pytest.approx([5**0.5 / 2, 2 + 1, 1], abs=1e-3)
    right = losses(Unbent(targets, turn.expand(1, 2, 3, 3)), positions, targets, normals, normals @ turn.T)
    assert right.tolist() == pytest.approx([0, 0, 0], abs=1e-3)
    assert float(weighted(terms, replace(TOY, edge=0.5, isometry=2.0))) == pytest.approx(
        terms[0] + 0.5 * terms[1] + 2 * terms[2]
    )


def test_batches_are_a_matter_of_their_number():
    one, again, other = batch(True, 3), batch(True, 3), batch(True, 4)
    assert torch.equal(one.points, again.points)
    assert torch.equal(one.positions, again.positions)
    assert not torch.equal(one.points, other.points)
    assert one.points.shape == (2, TOY.points, 3)
    assert torch.equal(one.heights[:1], one.heights[1:])


def test_sizes_that_do_not_fit_are_refused():
    for changes, message in (({"width": 33}, "33 for 2 heads"), ({"tokens": 65}, "only 64 points")):
        with pytest.raises(ConfigurationError, match=message):
            check_sizes(replace(TOY, **changes))
    with pytest.raises(ConfigurationError, match="did you mean plain"):
        field_named("plane")
    for each in FIELDS.values():
        assert from_card(each.described()) == each
    for described in ({}, {**TOY.described(), "colour": 1}, {**TOY.described(), "points": -1}, None):
        with pytest.raises(ConfigurationError):
            from_card(described)

"""Parts of a prediction that are put right before it is ranked, by hand."""

import pytest
import torch

from tools.studies.printed_network import means_of, pose_over_body, true_depth, true_mask

#: A row of four pixels: predicted at the first two, true at the last two and the second.
PREDICTION = torch.tensor([[[0.2, 0.4, 0.9, 0.9]], [[1.0, 0.8, 0.1, 0.0]]])
TRUTH = torch.tensor([[[0.0, 0.5, 0.6, 0.7]], [[0.0, 1.0, 1.0, 1.0]]])


def test_depth_or_mask_is_replaced_and_a_pixel_without_depth_has_that_of_the_nearest():
    of_depth, of_mask = true_depth(PREDICTION, TRUTH), true_mask(PREDICTION, TRUTH)
    assert torch.equal(of_depth, torch.tensor([[[0.5, 0.5, 0.6, 0.7]], [[1.0, 0.8, 0.1, 0.0]]]))
    assert torch.equal(of_mask, torch.tensor([[[0.2, 0.4, 0.4, 0.4]], [[0.0, 1.0, 1.0, 1.0]]]))


def test_no_pose_is_in_two_means():
    predictions = torch.tensor([0.0, 1.0, 5.0, 9.0])[:, None, None, None].expand(4, 2, 1, 1)
    assert means_of(1)(predictions, TRUTH)[:, 0, 0, 0].tolist() == [0, 1, 5, 9]
    assert means_of(2)(predictions, TRUTH)[:, 1, 0, 0].tolist() == [0.5, 7]


def test_variance_between_poses_is_told_over_that_between_bodies():
    images = torch.tensor([[0.0, 2.0], [10.0, 12.0]])[..., None]
    assert pose_over_body(images) == pytest.approx(1 / 25)

"""Losses of a streamed network: depth inside the mask, the mask, smoothness of what is smooth, and one code."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import torch
from torch import Tensor
from torch.nn import functional

from learned.streamed.configuration import Streamed

NAMES = ("depth loss", "mask loss", "gradient loss", "code loss", "form loss", "place loss", "point loss")
"""Columns of the history."""

WEIGHTS = ("gradient", "one_code", "one_form", "places", "points")
"""Fields of a configuration that weigh all of them but the first two."""

FORM_PIXELS = 4
"""Pixels per side that are averaged before forms are compared."""

_LEAST_SPREAD = 1e-6
"""Smallest variance between codes, lest all of them being one be divided by zero."""


def losses(
    prediction: Tensor,
    target: Tensor,
    code: Tensor,
    poses: int,
    configuration: Streamed,
    beside: Mapping[str, tuple[Tensor, Tensor]] = MappingProxyType({}),
) -> Tensor:
    """All terms, unweighted; those of weight zero are zero.

    Parameters
    ----------
    prediction, target
        Depth of each side, then the mask, shape (n, sides + 1, r, r).
    code
        Shape (n, code_size); the poses of one body are neighbours.
    poses
        Poses of each body.
    configuration
        Which terms count.
    beside
        What is predicted beside the images, with what is true. ``"places"``: canonical positions, shape (n, 3, s, s),
        and the true ones with their mask, shape (n, 4, s, s). ``"points"``: places of points, shape (n, p) each.

    Returns
    -------
    torch.Tensor
        Shape (7,), in the order of :data:`NAMES`.
    """
    mask = target[:, -1:]
    covered = mask.sum().clamp(min=1) * configuration.sides
    # Split once: the derivative of a slice is a whole image of zeros.
    predicted, predicted_mask = prediction.split([configuration.sides, 1], dim=1)
    depths = predicted - target[:, :-1]
    zero = depths.new_zeros(())
    return torch.stack(
        [
            (depths.square() * mask).sum() / covered,
            (predicted_mask - mask).square().mean(),
            gradient_loss(depths, mask) if configuration.gradient else zero,
            code_loss(code, poses) if configuration.one_code and poses > 1 else zero,
            code_loss(_shown(prediction, mask), poses) if configuration.one_form and poses > 1 else zero,
            place_loss(*beside["places"]) if "places" in beside else zero,
            functional.mse_loss(*beside["points"]) if "points" in beside else zero,
        ]
    )


def weighted(terms: Tensor, configuration: Streamed) -> Tensor:
    """The loss that is minimised, a scalar."""
    total = terms[0] + terms[1]
    for name, term in zip(WEIGHTS, terms[2:], strict=True):
        total = total + getattr(configuration, name) * term
    return total


def place_loss(predicted: Tensor, true: Tensor) -> Tensor:
    """Mean square of the distance of canonical positions, over the coarse pixels that show the body."""
    shown = true[:, 3:]
    return ((predicted - true[:, :3]).square() * shown).sum() / shown.sum().clamp(min=1)


def _shown(prediction: Tensor, mask: Tensor) -> Tensor:
    """Mask of a prediction, and its depths where the true mask is, in coarse pixels, shape (n, numbers)."""
    depths, predicted_mask = prediction.split([prediction.shape[1] - 1, 1], dim=1)
    shown = torch.cat([depths * mask, predicted_mask], dim=1)
    return functional.avg_pool2d(shown, FORM_PIXELS).flatten(1)


def gradient_loss(errors: Tensor, mask: Tensor) -> Tensor:
    """Mean square of the differences of the depth's error between neighbours that both show the body.

    An error that is the same everywhere moves the surface and costs nothing here; one that alternates is a waffle.

    Parameters
    ----------
    errors
        Predicted less true depth, shape (n, sides, r, r).
    mask
        Shape (n, 1, r, r).
    """
    total, count = errors.new_zeros(()), errors.new_zeros(())
    for one, other in (
        ((..., slice(1, None), slice(None)), (..., slice(-1), slice(None))),
        ((..., slice(1, None)), (..., slice(-1))),
    ):
        both = mask[one] * mask[other]
        total = total + ((errors[one] - errors[other]).square() * both).sum()
        count = count + both.sum() * errors.shape[1]
    return total / count.clamp(min=1)


def code_loss(code: Tensor, poses: int) -> Tensor:
    """Variance of the codes of one body over that of all codes: 0 where the pose leaves no trace, 1 at random.

    A ratio, for the distance alone is least where every body has the code zero.

    Parameters
    ----------
    code
        Shape (bodies * poses, code_size).
    poses
        Poses of each body.
    """
    of_body = code.float().view(-1, poses, code.shape[-1])
    means = of_body.mean(dim=1, keepdim=True)
    within = (of_body - means).square().sum(dim=-1).sum() / max(of_body.shape[0] * (poses - 1), 1)
    spread = (code.float() - code.float().mean(dim=0)).square().sum(dim=-1).sum() / max(len(code) - 1, 1)
    return within / spread.clamp(min=_LEAST_SPREAD)

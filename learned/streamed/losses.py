"""Losses of a streamed network: depth inside the mask, mask, depth gradients, codes, forms, places and points."""

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
"""Fields of a configuration with the weights of all terms but the first two."""

FORM_PIXELS = 4
"""Pixels per side that are averaged before forms are compared."""

_LEAST_SPREAD = 1e-6
"""Smallest variance between codes, which avoids a division by zero if all codes are equal."""


def losses(
    prediction: Tensor,
    target: Tensor,
    code: Tensor,
    poses: int,
    configuration: Streamed,
    beside: Mapping[str, tuple[Tensor, Tensor]] = MappingProxyType({}),
) -> Tensor:
    """Compute all terms of the loss, unweighted; terms of weight zero are zero.

    Parameters
    ----------
    prediction, target
        Depth of each side, then the mask, shape (n, sides + 1, r, r).
    code
        Codes, shape (n, code_size); the poses of a body are adjacent.
    poses
        Poses of each body.
    configuration
        Configuration, whose weights select the terms.
    beside
        Predictions other than images, with their targets. ``"places"``: canonical positions, shape (n, 3, s, s), and
        the true ones with their mask, shape (n, 4, s, s). ``"points"``: positions of points, shape (n, p) each.

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
    """Return the loss to minimise, a scalar."""
    total = terms[0] + terms[1]
    for name, term in zip(WEIGHTS, terms[2:], strict=True):
        total = total + getattr(configuration, name) * term
    return total


def place_loss(predicted: Tensor, true: Tensor) -> Tensor:
    """Return the mean squared distance of canonical positions over the coarse pixels that show the body."""
    shown = true[:, 3:]
    return ((predicted - true[:, :3]).square() * shown).sum() / shown.sum().clamp(min=1)


def _shown(prediction: Tensor, mask: Tensor) -> Tensor:
    """Return the depths inside the true mask, then the predicted mask, in coarse pixels, shape (n, numbers)."""
    depths, predicted_mask = prediction.split([prediction.shape[1] - 1, 1], dim=1)
    shown = torch.cat([depths * mask, predicted_mask], dim=1)
    return functional.avg_pool2d(shown, FORM_PIXELS).flatten(1)


def gradient_loss(errors: Tensor, mask: Tensor) -> Tensor:
    """Return the mean squared difference of depth errors between neighbouring pixels that both show the body.

    A constant error shifts the surface and costs nothing here, unlike one that alternates between pixels.

    Parameters
    ----------
    errors
        Predicted minus true depth, shape (n, sides, r, r).
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
    """Return the variance of the codes of a body over that of all codes: 0 if they ignore the pose, 1 at random.

    The ratio is necessary, because the numerator alone is smallest if all codes are zero.

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

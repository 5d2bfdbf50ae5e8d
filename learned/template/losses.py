"""Losses of a template and its deformations, by [Deng, Yang and Tong 2021, DIF-Net] and their loss.py."""

from __future__ import annotations

import torch
from torch import Tensor

from learned.template.configuration import Template
from learned.template.network import TemplateNetwork

NAMES = (
    "distance loss", "normal loss", "eikonal loss", "template normal loss", "smoothness loss", "correction loss",
    "code loss",
)  # fmt: skip
"""Columns of the history."""

FARTHEST = 0.5
"""Distances beyond this count as this, as in the authors' implementation: far away little depends on them."""


def losses(network: TemplateNetwork, codes: Tensor, points: Tensor, directions: Tensor, distances: Tensor) -> Tensor:
    """All terms, unweighted.

    DIF-Net has a further one for points of unknown distance, which keeps them off the surface; here all distances are
    known.

    Parameters
    ----------
    network
        The fields.
    codes
        Shape (n, code_size).
    points, directions
        Positions around each shape, the first half of them on its surface, and the gradient of the distance there,
        shape (n, 2 * p, 3).
    distances
        Signed distances there, shape (n, 2 * p).

    Returns
    -------
    torch.Tensor
        Shape (7,), in the order of :data:`NAMES`.
    """
    places, correction = network.deformed(points, codes, derivatives=True)
    field = network.template_distances(places[..., 0, :], derivatives=True)
    found = (field + correction)[..., 0, 0]
    of_template = field[..., 1:, 0]
    # Row i of ``places[..., 1:, :]`` is the derivative of the position by coordinate i.
    gradient = (places[..., 1:, :] @ of_template[..., None])[..., 0] + correction[..., 1:, 0]
    on_surface = slice(points.shape[1] // 2)
    axes = torch.eye(3, dtype=points.dtype, device=points.device)
    moved = places[..., 1:, :] - axes
    return torch.stack(
        [
            (found.clamp(-FARTHEST, FARTHEST) - distances.clamp(-FARTHEST, FARTHEST)).abs().mean(),
            _angle(gradient[:, on_surface], directions[:, on_surface]),
            (gradient.norm(dim=-1) - 1).abs().mean(),
            _angle(of_template[:, on_surface], directions[:, on_surface]),
            # The gradient of each component of the deformation is a column.
            _lengths(moved.transpose(-1, -2)).mean(),
            correction[..., 0, 0].abs().mean(),
            codes.square().mean(),
        ]
    )


def weighted(terms: Tensor, configuration: Template) -> Tensor:
    """The loss that is minimised, a scalar."""
    weights = (
        1.0, configuration.normal, configuration.eikonal, configuration.template_normal, configuration.smoothness,
        configuration.correction, configuration.code,
    )  # fmt: skip
    return (terms * terms.new_tensor(weights)).sum()


def _angle(one: Tensor, other: Tensor) -> Tensor:
    """One less the cosine of the angle between directions, in the mean."""
    return (1 - torch.nn.functional.cosine_similarity(one, other, dim=-1)).mean()


def _lengths(vectors: Tensor) -> Tensor:
    """Norms whose gradient is finite where a vector is zero, as all of them are before training."""
    return (vectors.square().sum(dim=-1) + 1e-12).sqrt()

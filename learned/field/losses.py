"""Losses of the field: canonical positions, rotations of the surface around them, and lengths that stay."""

from __future__ import annotations

import torch
from torch import Tensor

from learned.field.configuration import Field
from learned.field.network import Unbent

NAMES = ("position loss", "edge loss", "isometry loss")
"""Columns of the history."""

_LEAST = 1e-8
"""Added to squared distances, lest their root have no gradient at zero."""


def losses(found: Unbent, positions: Tensor, targets: Tensor, normals: Tensor, target_normals: Tensor) -> Tensor:
    """All terms, unweighted.

    Parameters
    ----------
    found
        What the field says of the positions.
    positions, targets
        In the pose and in the canonical pose, shape (n, 2 p, 3): the first p are the starts of p edges along the
        surface, the others their ends.
    normals, target_normals
        Unit normals there, shape (n, 2 p, 3).

    Returns
    -------
    torch.Tensor
        Shape (3,), in the order of :data:`NAMES`. Mean distance to the true positions, in roots of the area; mean
        squared error of turned edges, relative to their lengths, and of turned normals; mean squared relative change
        of the lengths of edges.
    """
    edges, true_edges, found_edges = _edges(positions), _edges(targets), _edges(found.positions)
    lengths = _lengths(edges)
    starts, ends = found.rotations.chunk(2, dim=1)
    turned = ((starts + ends) / 2 @ edges[..., None])[..., 0]
    facing = (found.rotations @ normals[..., None])[..., 0]
    return torch.stack(
        [
            _lengths(found.positions - targets).mean(),
            ((turned - true_edges) / lengths[..., None]).square().sum(-1).mean()
            + (facing - target_normals).square().sum(-1).mean(),
            (_lengths(found_edges) / lengths - 1).square().mean(),
        ]
    )


def weighted(terms: Tensor, configuration: Field) -> Tensor:
    """The loss that is minimised, a scalar."""
    return terms[0] + configuration.edge * terms[1] + configuration.isometry * terms[2]


def _edges(points: Tensor) -> Tensor:
    starts, ends = points.chunk(2, dim=1)
    return ends - starts


def _lengths(vectors: Tensor) -> Tensor:
    return (vectors.square().sum(-1) + _LEAST).sqrt()

"""Distances between predicted images and the true ones."""

from __future__ import annotations

from torch import Tensor

from learned.images import COVERED


def overlaps(predictions: Tensor, targets: Tensor) -> Tensor:
    """Intersection over union of the masks of each pair, shape (n,); both have depth and mask, shape (n, 2, r, r)."""
    predicted, true = predictions[:, 1] > COVERED, targets[:, 1] > COVERED
    return (predicted & true).sum(dim=(1, 2)) / (predicted | true).sum(dim=(1, 2)).clamp(min=1)


def measures(predictions: Tensor, targets: Tensor) -> dict[str, float]:
    """Overlap of masks, and error of depths where both masks are.

    Parameters
    ----------
    predictions, targets
        Depth and mask, shape (n, 2, r, r).

    Returns
    -------
    dict
        ``"mask overlap"``: intersection over union, mean over the images. ``"depth error"``: mean absolute error inside
        both masks, as a share of the depth of the frame.
    """
    both = (predictions[:, 1] > COVERED) & (targets[:, 1] > COVERED)
    error = (predictions[:, 0] - targets[:, 0]).abs()[both]
    overlap = float(overlaps(predictions, targets).mean())
    return {"mask overlap": overlap, "depth error": float(error.mean()) if len(error) else float("nan")}

"""Pictures of a training: predictions for training and validation pairs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from learned.images import COVERED
from learned.training import overlaps

if TYPE_CHECKING:
    from torch import Tensor

COLUMNS = 10
"""Samples per picture."""


def draw_samples(
    names: Sequence[str], images: Tensor, predictions: Tensor, targets: Tensor, path: Path, title: str
) -> None:
    """Draw input, predicted and true depth and mask: the three worst overlaps, and others from worse to better.

    Parameters
    ----------
    names
        One per sample.
    images
        Depth, shape (n, 1, r, r).
    predictions, targets
        Depth and mask, shape (n, 2, r, r).
    path, title
        File and title of the picture.
    """
    from matplotlib.figure import Figure

    overlap = overlaps(predictions, targets).numpy()
    order = np.argsort(overlap, kind="stable")
    chosen = np.unique(np.concatenate([np.arange(3), np.linspace(3, len(order) - 1, COLUMNS - 3).round().astype(int)]))
    chosen = order[chosen[chosen < len(order)]]
    figure = Figure(figsize=(1.3 * len(chosen), 6.75), layout="constrained")
    grid = figure.subplots(5, len(chosen), squeeze=False)
    for column, sample in zip(grid.T, chosen, strict=True):
        (depth, mask), (true_depth, true_mask) = predictions[sample].numpy(), targets[sample].numpy()
        depths = images[sample, 0].numpy(), np.where(mask > COVERED, depth, 0), true_depth
        for axes, picture in zip(column[:3], depths, strict=True):
            axes.imshow(np.where(picture > 0, picture, np.nan), cmap="viridis")
        for axes, picture in zip(column[3:], (mask, true_mask), strict=True):
            axes.imshow(picture, vmin=0, vmax=1, cmap="gray")
        column[0].set_title(f"{names[sample]}\n{overlap[sample]:.2f}", fontsize=5)
    for axes in grid.ravel():
        axes.set(xticks=[], yticks=[])
    rows = ("input", "predicted depth", "true depth", "predicted mask", "true mask")
    for axes, name in zip(grid[:, 0], rows, strict=True):
        axes.set_ylabel(name, fontsize=7)
    figure.suptitle(f"{title}; number: overlap of masks", fontsize=8)
    figure.savefig(path, dpi=110)

"""Pictures of a training: the losses, and predictions for seen and unseen shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from learned.images import COVERED
from learned.training.loop import overlaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray
    from torch import Tensor

COLUMNS = 10
"""Samples per grid."""


def draw_history(history: Sequence[Mapping[str, float]], path: Path, title: str) -> None:
    """Draw the losses, and mask overlap and depth error of unseen pairs, over the epochs."""
    from matplotlib.figure import Figure

    epochs = [row["epoch"] for row in history]
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, style in (("depth loss", "C0"), ("mask loss", "C1")):
        left.semilogy(epochs, [row[name] for row in history], style, label=name)
        unseen = f"unseen {name}"
        if any(unseen in row for row in history):
            left.semilogy(*_series(history, unseen), style + "--", label=unseen)
    switch = next((row["epoch"] for row in history if row["alpha"] != history[0]["alpha"]), None)
    for axes in (left, right):
        if switch is not None:
            axes.axvline(switch, color="0.7", linewidth=1, label="full weight of depth" if axes is left else None)
        axes.set_xlabel("epoch")
    left.set_ylabel("mean squared error")
    left.legend(fontsize=7)
    right.plot(*_series(history, "unseen mask overlap"), "C1", label="mask overlap")
    right.plot(*_series(history, "unseen depth error"), "C0", label="depth error")
    right.set_title("unseen pairs (nothing is chosen by them)", fontsize=8)
    right.set_ylim(0, 1)
    right.legend(fontsize=7)
    figure.suptitle(title, fontsize=9)
    figure.savefig(path, dpi=110)


def draw_samples(
    names: Sequence[str],
    images: Tensor,
    predictions: Tensor,
    targets: Tensor,
    path: Path,
    title: str,
) -> None:
    """Draw input, predicted and true depth and mask, worst overlap first.

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
    # The three worst show failures; the others are spread over the whole range.
    chosen = np.unique(np.concatenate([np.arange(3), np.linspace(3, len(order) - 1, COLUMNS - 3).round().astype(int)]))
    chosen = order[chosen[chosen < len(order)]]
    rows = ("input", "predicted depth", "true depth", "predicted mask", "true mask")
    figure = Figure(figsize=(1.3 * len(chosen), 1.35 * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), len(chosen), squeeze=False)
    for column, sample in enumerate(chosen):
        depth, mask = predictions[sample].numpy()
        true_depth, true_mask = targets[sample].numpy()
        pictures = (images[sample, 0].numpy(), np.where(mask > COVERED, depth, 0), true_depth, mask, true_mask)
        for axes, picture, row in zip(grid[:, column], pictures, rows, strict=True):
            _show(axes, picture, is_depth="mask" not in row)
        grid[0, column].set_title(f"{names[sample]}\n{overlap[sample]:.2f}", fontsize=5)
    for axes, row in zip(grid[:, 0], rows, strict=True):
        axes.set_ylabel(row, fontsize=7)
    figure.suptitle(f"{title}; number: overlap of masks, worst first", fontsize=8)
    figure.savefig(path, dpi=110)


def _show(axes: Axes, picture: NDArray[np.float32], is_depth: bool) -> None:
    if is_depth:
        seen = picture > 0
        low, high = (picture[seen].min(), picture[seen].max()) if seen.any() else (0.0, 1.0)
        axes.imshow(np.where(seen, picture, np.nan), vmin=low, vmax=max(high, low + 1e-3), cmap="viridis")
    else:
        axes.imshow(picture, vmin=0, vmax=1, cmap="gray")
    axes.set_xticks([])
    axes.set_yticks([])


def _series(history: Sequence[Mapping[str, float]], name: str) -> tuple[list[float], list[float]]:
    rows = [row for row in history if name in row]
    return [row["epoch"] for row in rows], [row[name] for row in rows]

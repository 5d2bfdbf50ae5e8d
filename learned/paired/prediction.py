"""From a depth image to the surface of the predicted canonical pose."""

from __future__ import annotations

from pathlib import Path

import torch

from benchmark.geometry.depth import DepthImage
from benchmark.geometry.mesh import Mesh
from learned.images import checked_image, enlarge, shrink, smooth
from learned.paired.model import load_model, predict
from learned.surface import surface_behind


def canonical_depth(folder: Path, depth: DepthImage, smoothing: float = 0.0) -> DepthImage:
    """Predict the depth image of the canonical pose.

    Parameters
    ----------
    folder
        The model.
    depth
        Depth image, shape (500, 500).
    smoothing
        Standard deviation, in pixels of the network, of the Gaussian that smooths the depth inside the mask.

    Returns
    -------
    numpy.ndarray
        Shape (500, 500), float32, 0 where the predicted mask is at most a half.

    Raises
    ------
    InvalidMesh, UnsupportedShape
        If the image does not fit, or shows nothing.
    ConfigurationError
        If the model does not fit its card.
    """
    network, card = load_model(folder)
    image = shrink(checked_image(depth), int(card["schedule"]["resolution"]))[:1]
    return enlarge(smooth(predict(network, torch.from_numpy(image)), smoothing))


def canonical_surface(
    folder: Path, depth: DepthImage, smoothing: float = 0.0, jump: float | None = None
) -> tuple[Mesh, dict[str, float | str]]:
    """Surface behind the predicted image, of unit area, and facts about it; see :func:`canonical_depth`.

    Parameters
    ----------
    folder, depth, smoothing
        As there.
    jump
        Largest depth difference along an edge, as in :func:`surface_behind`.

    Raises
    ------
    UnsupportedShape
        If the network predicts an empty mask.
    """
    return surface_behind(canonical_depth(folder, depth, smoothing), jump)

"""From a depth image to the surface of the predicted canonical pose."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from benchmark.errors import UnsupportedShape
from benchmark.geometry.depth import DepthImage, back_project
from benchmark.geometry.mesh import Mesh
from learned.images import checked_image, enlarge, shrink, smooth
from learned.model import load_model, predict


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


def surface_behind(predicted: DepthImage, jump: float | None = None) -> tuple[Mesh, dict[str, float | str]]:
    """Surface behind a predicted image, of unit area, and facts about it; sampled like the view input.

    A camera's image shows where one part hides another by a jump of its depth alone, so the view input is cut there. A
    predicted image comes with a mask that was learned for saying what is surface, and its depth with a noise as large
    as such jumps: cut there, it falls into shreds.

    Parameters
    ----------
    predicted
        Depth image, shape (500, 500), 0 outside the predicted mask.
    jump
        Largest depth difference along an edge, as a share of the half width; None cuts nowhere inside the mask.

    Raises
    ------
    UnsupportedShape
        If the image is empty.
    """
    if not predicted.any():
        raise UnsupportedShape("the network predicts an empty mask", "train it for longer or on shapes like this one")
    surface, report = back_project(predicted, 1.0, jump=math.inf if jump is None else jump)
    notes: dict[str, float | str] = {
        "predicted_foreground": report.foreground,
        "predicted_pieces": report.pieces,
        "predicted_bridges": report.bridges,
    }
    return surface.with_vertices(surface.vertices / surface.area**0.5), notes

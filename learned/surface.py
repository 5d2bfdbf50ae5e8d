"""The surface behind a predicted image."""

from __future__ import annotations

import math

from benchmark.errors import UnsupportedShape
from benchmark.geometry.depth import DepthImage, back_project
from benchmark.geometry.mesh import Mesh


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

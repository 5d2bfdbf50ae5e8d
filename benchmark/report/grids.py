"""Pictures in a grid, and figures as files: all that a command needs to draw a single form."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmark.files import write_atomically

#: Width in inches of the text of a two-column paper.
TEXT_WIDTH = 7.16

#: Pixels per inch that papers ask for.
DPI = 300

#: Size in points of titles and names in figures.
TITLE_SIZE = 7

#: Height in inches of the titles above pictures.
_TITLE_HEIGHT = 0.44

#: Metadata by file extension, without the date and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}


def grid(columns: Sequence[tuple[str, Sequence[Any]]], side: float = 1.0) -> Figure:
    """Return a figure of pictures in columns, each column below its title.

    Parameters
    ----------
    columns
        Title and pictures of each column. A picture is an image, or an array of grey or colour
        values; None leaves its place empty.
    side
        Side of a picture in inches.
    """
    n_rows = max(len(pictures) for _, pictures in columns)
    height = _TITLE_HEIGHT + n_rows * side
    figure = Figure((side * len(columns), height))
    axes = figure.subplots(n_rows, len(columns), squeeze=False)
    figure.subplots_adjust(0, 0, 1, n_rows * side / height, 0, 0)
    for place in figure.axes:
        place.axis("off")
    for places, (title, pictures) in zip(axes.T, columns, strict=True):
        places[0].set_title(title, fontsize=TITLE_SIZE, parse_math=False)
        for place, picture in zip(places, pictures, strict=False):
            if picture is not None:
                place.imshow(np.asarray(picture), cmap="gray")
    return figure


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PDF, PNG or SVG by its extension."""
    content = figure_bytes(figure, path.suffix.lower())
    write_atomically(path, lambda file: file.write(content))


def figure_bytes(figure: Figure, ending: str) -> bytes:
    """Return a figure as PDF, PNG or SVG, without dates; publishers take the fonts (Type 42)."""
    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "figure", "pdf.fonttype": 42}):
        figure.savefig(file, format=ending[1:], metadata=_UNDATED[ending], dpi=DPI)
    return file.getvalue()

"""Pictures in a grid, and figures as files: all that a command needs to draw a single form."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from benchmark.files import write_atomically

#: Width in inches of the text of a two-column paper.
TEXT_WIDTH = 7.16

#: Pixels per inch that papers ask for.
DPI = 300

#: Size in points of titles and names in figures.
TITLE_SIZE = 7

#: Letters of the title of a picture to the inch.
LETTERS_PER_INCH = 18

#: Distance of the lines of a title in units of its size, and the room around them in inches.
_LINE_SPACING = 1.2
_ROOM_OF_TITLES = 0.12
_POINTS_PER_INCH = 72

#: What words stand on, so that they can be read on dark pages, too.
ON_WHITE = {
    "boxstyle": "round,pad=0.2",
    "facecolor": "white",
    "edgecolor": "none",
    "antialiased": False,
}

#: Metadata by file extension, without the date and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}


@contextmanager
def usual_style() -> Iterator[None]:
    """Draw with the settings that matplotlib comes with.

    Those of a user, as in a file ``matplotlibrc``, must not change a figure.
    """
    with mpl.style.context({}, after_reset=True):
        yield


@usual_style()
def grid(
    columns: Sequence[tuple[str, Sequence[Any]]],
    side: float = 1.0,
    below: float = 0.0,
    title_size: float = TITLE_SIZE,
) -> Figure:
    """Return a figure of pictures in columns, each column below its title.

    The figure is transparent, and its words stand on white.

    Parameters
    ----------
    columns
        Title and pictures of each column. A picture is an image, or an array of grey or colour
        values; None leaves its place empty.
    side
        Side of a picture in inches.
    below
        Room below each picture in inches, for words.
    title_size
        Size of the titles in points.
    """
    n_rows = max(len(pictures) for _, pictures in columns)
    of_pictures = n_rows * (side + below)
    height = of_pictures + _height_of_titles([title for title, _ in columns], title_size)
    figure = Figure((side * len(columns), height), facecolor="none")
    axes = figure.subplots(n_rows, len(columns), squeeze=False)
    figure.subplots_adjust(0, below / height, 1, of_pictures / height, 0, below / side)
    for place in figure.axes:
        place.axis("off")
    for places, (title, pictures) in zip(axes.T, columns, strict=True):
        if title:
            places[0].set_title(title, fontsize=title_size, parse_math=False, bbox=ON_WHITE)
        for place, picture in zip(places, pictures, strict=False):
            if picture is not None:
                place.imshow(np.asarray(picture), cmap="gray")
                place.set_adjustable("datalim")  # titles stand at one height
    return figure


def _height_of_titles(titles: Sequence[str], size: float) -> float:
    """Return the inches that titles of one or more lines take; 0 without titles."""
    if not any(titles):
        return 0.0
    n_lines = max(title.count("\n") + 1 for title in titles)
    return _ROOM_OF_TITLES + n_lines * _LINE_SPACING * size / _POINTS_PER_INCH


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PDF, PNG or SVG by its extension."""
    content = figure_bytes(figure, path.suffix.lower())
    write_atomically(path, lambda file: file.write(content))


@usual_style()
def figure_bytes(figure: Figure, ending: str) -> bytes:
    """Return a figure as PDF, PNG or SVG, without dates; publishers take the fonts (Type 42)."""
    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "figure", "pdf.fonttype": 42}):
        figure.savefig(file, format=ending[1:], metadata=_UNDATED[ending], dpi=DPI)
    return file.getvalue()

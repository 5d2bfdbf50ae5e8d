"""What networks predict of animals and of scans, beside the truth: ``canonical_depths.py
[animals|scans]``.

Draws results/figures/canonical-animals.png and canonical-scans.png, the counterparts of figures 4
and 5 of the paper: depth in the canonical pose, of subjects that no network has seen. Animals need
CANONICAL_FORMS_DATA. Shapes were chosen before any picture was drawn.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from predictions import add_scale, inside

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.commands.selection import data_folder
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.geometry.depth import render_depth
from benchmark.pipeline.prepared import frame_of
from benchmark.report.grids import ON_WHITE, TEXT_WIDTH, write_figure
from learned.images import resampled
from learned.methods import Learned, Streamed, TrainedNetwork, WideExtra

FIGURES = Path(__file__).parents[1] / "figures"

#: Pixels per side of the truth.
SIZE = 500

#: Margin around the bodies, as a share of the side of a panel.
MARGIN = 0.02


@dataclass(frozen=True)
class Picture:
    """A picture of some shapes of a data set and of what some networks predict of them."""

    dataset: str
    shapes: tuple[str, ...]
    networks: dict[str, tuple[type[TrainedNetwork], str]]


PICTURES = {
    "animals": Picture(
        "tosca",
        ("cat4", "cat8", "horse6", "horse15"),
        {
            "128 px,\ngenerated animals": (Learned, "animals-III/literal-seed0"),
            "500 px,\ngenerated animals": (Learned, "animals-III/as_printed-seed0"),
            "extra animals": (WideExtra, "animals-sampled/wide-extra-seed0"),
        },
    ),
    "scans": Picture(
        "humans-scanlike",
        ("kicking", "throwing"),
        {
            "128 px": (Learned, "people-fold-0/literal-seed0"),
            "500 px": (Learned, "people-fold-0/as_printed-seed0"),
            "extra data": (WideExtra, "humans-sampled/wide-extra-seed0"),
            "streamed": (Streamed, "humans-varied/streamed-people-seed0"),
        },
    ),
}

#: Subjects of scans that are shown, the first ones.
N_SUBJECTS = 2


def chosen(picture: Picture, shapes: ShapeSet) -> list[Entry]:
    """Return the shapes of a picture: by name, or poses of the first subjects."""
    subjects = [*dict.fromkeys(entry.subject for entry in shapes.shapes)][:N_SUBJECTS]
    return [
        entry
        for entry in shapes.shapes
        if entry.identifier in picture.shapes
        or (entry.subject in subjects and entry.pose in picture.shapes)
    ]


def panels(picture: Picture) -> tuple[list[list[NDArray[np.float64]]], list[str]]:
    """Return a row of panels for each shape, NaN outside of bodies, and the titles of columns."""
    shapes = open_dataset(picture.dataset, data_folder())
    half_width = frame_of(shapes)
    canonical = canonical_shapes(shapes)
    networks = {
        title: kind(configuration=_configuration(model)).load(Learned.shipped_models / model)
        for title, (kind, model) in picture.networks.items()
    }
    rows = []
    for entry in chosen(picture, shapes):
        camera = shapes.camera(entry)
        meshes = (shapes.load(entry), shapes.load(canonical[entry.subject]))
        image, true = (render_depth(mesh, camera, half_width) for mesh in meshes)
        row = [np.where(image > 0, image, np.nan)]
        row.append(inside(torch.from_numpy(resampled(true, SIZE)).double()))
        for network in networks.values():
            front, *_, mask = network.predict(image)
            row.append(inside(torch.stack([front, mask])))
        rows.append(row)
    return rows, ["input", "truth", *networks]


def _configuration(model: str) -> str:
    """Return the name of the configuration of a model from that of its folder."""
    return Path(model).name.partition("-seed")[0]


def window(panels: list[NDArray[np.float64]], ratio: float) -> NDArray[np.float64]:
    """Return where the bodies of a column lie: left, right, bottom, top as shares of its side, of a
    ratio of sides.
    """
    extents = np.array([extent(panel) for panel in panels])
    low = extents[:, :2].min(axis=0)
    high = extents[:, 2:].max(axis=0)
    centre = (low + high) / 2
    width = max(high[0] - low[0], (high[1] - low[1]) / ratio)
    half = (0.5 + MARGIN) * width * np.array([1, ratio])
    return np.array(
        [*(centre[0] + half[0] * np.array([-1, 1])), *(centre[1] + half[1] * np.array([1, -1]))]
    )


def extent(panel: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return where the body of a panel lies, as shares of its side: left, top, right, bottom."""
    rows, columns = (np.flatnonzero(np.isfinite(panel).any(axis=axis)) for axis in (1, 0))
    size = len(panel)
    return columns[0] / size, rows[0] / size, (columns[-1] + 1) / size, (rows[-1] + 1) / size


def drawn(rows: list[list[NDArray[np.float64]]], titles: list[str]) -> Figure:
    """Draw a row of panels for each shape, each column cut to its bodies; depth in one scale but
    for the input. The picture is transparent, with its words on white.
    """
    extents = np.array([extent(row[1]) for row in rows])
    ratio = (extents[:, 3] - extents[:, 1]).max() / (extents[:, 2] - extents[:, 0]).max()
    side = 0.9 * TEXT_WIDTH / len(titles)
    size = (TEXT_WIDTH, 0.35 + 1.02 * ratio * side * len(rows))
    figure = Figure(size, layout="constrained", facecolor="none")
    places = figure.subplots(len(rows), len(titles), squeeze=False)
    spread = max(np.nanmax(np.abs(row[1])) for row in rows)
    for number, title in enumerate(titles):
        column = [row[number] for row in rows]
        shown = window(column, ratio)
        limits = {} if number == 0 else {"vmin": -spread, "vmax": spread}
        for place, panel in zip(places[:, number], column, strict=True):
            place.imshow(panel, cmap="viridis", interpolation="nearest", **limits)
            place.set_axis_off()
            place.set_xlim(shown[:2] * len(panel))
            place.set_ylim(shown[2:] * len(panel))
        places[0, number].set_title(title, fontsize=7, bbox=ON_WHITE)
    add_scale(figure, places, "depth about its mean (not of inputs)", shrink=0.5)
    return figure


def main() -> None:
    """Draw the pictures that are named, or all."""
    torch.set_num_threads(1)
    for name in sys.argv[1:] or PICTURES:
        write_figure(drawn(*panels(PICTURES[name])), FIGURES / f"canonical-{name}.png")


if __name__ == "__main__":
    main()

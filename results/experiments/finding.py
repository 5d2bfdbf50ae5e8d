"""The finding in a picture: ``python results/experiments/finding.py``.

Draws results/figures/finding.png from published records: DCG on TOSCA, complete surfaces, of the
paper's eight canonical forms in the paper and here, of no form, surface area and ShapeDNA, with
intervals over classes, and of a random order. It is drawn for light and dark pages, and again for
the narrow screens of telephones.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.pipeline.record_files import read_records
from benchmark.protocols.tables import TITLES
from benchmark.reference.paper import CLASSICAL, PRINTED
from benchmark.report.grids import TEXT_WIDTH, write_figure
from benchmark.report.table_view import TableView
from benchmark.report.tables import table_views

RESULTS = Path(__file__).parents[1]
FIGURES = RESULTS / "figures"

MEASURE = "DCG"
COLUMN = "ours"

#: What needs no canonical form, with the titles of the picture.
CONTROLS = {
    "identity": "no canonical form",
    "surface-area": "surface area alone",
    "shape-dna": "ShapeDNA",
}


class Theme(NamedTuple):
    """Colours of a picture on a light or a dark page."""

    page: str
    text: str
    lines: str
    ours: str
    paper: str


THEMES = {
    "": Theme("#ffffff", "#1f2328", "#d1d9e0", "#2f6db5", "#b5482f"),
    "-dark": Theme("#0d1117", "#e6edf3", "#3d444d", "#6cb0f5", "#f0926e"),
}

#: Width and height in inches by the end of the name.
SIZES = {"": (TEXT_WIDTH, 3.5), "-narrow": (TEXT_WIDTH / 2, 3.9)}

#: Letters to the inch of the label of the axis.
LETTERS_PER_INCH = 13


class Line(NamedTuple):
    """A method in the picture; the paper has no score of a control."""

    title: str
    ours: float
    interval: tuple[float, float]
    paper: float | None


def lines(view: TableView) -> list[Line]:
    """Return the methods from top to bottom: controls, then forms from the paper's best to its
    last.
    """
    scored = {row.method: row.scored[COLUMN] for row in view.rows if COLUMN in row.scored}
    of_paper = {name: PRINTED["III"][name][MEASURE] for name in CLASSICAL}
    forms = sorted(CLASSICAL, key=lambda name: -of_paper[name])
    controls = sorted(CONTROLS, key=lambda name: -scored[name].means[MEASURE])
    titles = {**TITLES, **CONTROLS}
    return [
        Line(
            titles[name],
            scored[name].means[MEASURE],
            scored[name].intervals[MEASURE],
            of_paper.get(name),
        )
        for name in (*controls, *forms)
    ]


def picture(view: TableView, theme: Theme, size: tuple[float, float]) -> Figure:
    """Draw a line for each method on one axis."""
    drawn = lines(view)
    figure = Figure(size, layout="constrained", facecolor=theme.page)
    place = figure.subplots()
    places = [-number - 0.6 * (number >= len(CONTROLS)) for number in range(len(drawn))]
    for y, line in zip(places, drawn, strict=True):
        place.plot(line.interval, (y, y), color=theme.ours, lw=2, alpha=0.45, zorder=1)
        place.plot(line.ours, y, "o", color=theme.ours, ms=6.5, zorder=3)
        if line.paper is not None:
            place.plot(line.paper, y, "D", mfc="none", mec=theme.paper, mew=1.5, ms=6, zorder=4)
    place.set_yticks(places, [line.title for line in drawn])
    chance = view.chance[COLUMN][MEASURE]
    place.axvline(chance, color=theme.text, lw=1, ls=(0, (3, 3)), zorder=1)
    beside = {"va": "center", "fontsize": 8, "color": theme.text}
    place.text(chance + 0.006, places[-1], "random order", **beside)
    label = f"{MEASURE} on {view.title}, complete surfaces (higher is better)"
    width, _ = size
    figure.supxlabel(fill(label, round(LETTERS_PER_INCH * width)), color=theme.text, fontsize=9)
    _explain(figure, place, theme)
    _style(place, theme)
    return figure


def _explain(figure: Figure, place: Axes, theme: Theme) -> None:
    """Say above the axis what the marks are."""
    place.plot([], [], "o-", color=theme.ours, lw=2, ms=6.5, label="here, with 95 % interval")
    place.plot([], [], "D", mfc="none", mec=theme.paper, mew=1.5, ms=6, label="in the paper")
    figure.legend(
        loc="outside upper center",
        ncols=2,
        frameon=False,
        fontsize=9,
        labelcolor=theme.text,
        borderpad=0.2,
    )


def _style(place: Axes, theme: Theme) -> None:
    """Leave what a reader needs: names, the axis, and faint lines to read it by."""
    place.set_facecolor(theme.page)
    place.set_xlim(0.4, 1)
    place.grid(axis="x", color=theme.lines, lw=0.7)
    place.set_axisbelow(True)
    place.tick_params(length=0, labelsize=9, colors=theme.text)
    for side in place.spines.values():
        side.set_visible(False)


def main() -> None:
    """Write the picture for both kinds of pages."""
    views = table_views(read_records(RESULTS, local=False), ["III"], datasets=["tosca"])
    (view,) = (view for view in views if view.table.identifier == "III")
    for (narrow, size), (dark, theme) in product(SIZES.items(), THEMES.items()):
        write_figure(picture(view, theme, size), FIGURES / f"finding{narrow}{dark}.png")


if __name__ == "__main__":
    main()

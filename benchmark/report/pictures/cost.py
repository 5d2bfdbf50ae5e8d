"""Accuracy against cost, with the front of the methods than which none is both cheaper and better."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.ticker import LogLocator, NullFormatter

from benchmark.api.contracts import Input
from benchmark.errors import ConfigurationError
from benchmark.report.content import TableContent
from benchmark.report.rounding import millionths
from benchmark.report.statistics.table_significance import CONTROL, pareto_front
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Measure on the upright axis.
MEASURE = "DCG"

#: Inches of one panel: a column of a paper.
_SIZE = (3.5, 2.9)

#: Characters of a title.
_LONGEST = 22

#: Of the families of methods.
COLOURS = {"paper": "#2f6fb7", "extended": "#2a9d8f", CONTROL: "#b0772e"}
_MARKS = {"paper": "o", "extended": "D", CONTROL: "s"}


def cost_figure(table: TableContent, measure: str = MEASURE) -> Figure:
    """Draw a panel for each input of a table: seconds a shape, all phases, against a measure with its interval.

    Controls are drawn, and take no part in the front.

    Raises
    ------
    ConfigurationError
        If no row has scores and a cost.
    """
    from matplotlib.figure import Figure

    inputs = [input_ for input_ in table.inputs if _points(table, input_, measure)]
    if not inputs:
        raise ConfigurationError("no row of the table has scores and a cost", "run its methods here")
    figure = Figure(figsize=(_SIZE[0] * len(inputs), _SIZE[1]), dpi=300, layout="constrained")
    axes = figure.subplots(1, len(inputs), squeeze=False, sharey=True)[0]
    for place, input_ in zip(axes, inputs, strict=True):
        _panel(place, table, input_, measure)
    axes[0].set_ylabel(measure, fontsize=8)
    return figure


def _points(table: TableContent, input_: Input, measure: str) -> dict[str, tuple[float, float]]:
    """Seconds and score of each row that has both, by method."""
    found = {}
    for row in table.rows:
        cell = row.cells.get(input_)
        if cell is not None and cell.scores and cell.seconds:
            found[row.method] = (cell.seconds, millionths(cell.scores[measure]))
    return found


def _panel(place: Axes, table: TableContent, input_: Input, measure: str) -> None:
    points = _points(table, input_, measure)
    rows = {row.method: row for row in table.rows}
    judged = {key[0]: each for key, each in table.significance.items() if key[1:] == (input_, measure)}
    front = pareto_front({name: point for name, point in points.items() if rows[name].family != CONTROL})
    if front:
        place.step(
            *zip(*(points[name] for name in front), strict=True), where="post", color="#2f6fb7", lw=1.2, zorder=1
        )
    for name, (seconds, score) in points.items():
        family = rows[name].family if rows[name].family in COLOURS else "extended"
        if name in judged:
            place.plot([seconds] * 2, [judged[name].low, judged[name].high], color=COLOURS[family], lw=0.7, alpha=0.35)
        edge = "black" if name in front else "none"
        place.plot(seconds, score, _MARKS[family], color=COLOURS[family], markersize=8, mec=edge, mew=0.9, zorder=3)
    _label(place, points, {name: clean(rows[name].title) for name in points})
    place.axhline(table.chance[measure], color="0.6", lw=0.7, ls=(0, (4, 3)), zorder=0)
    place.set_xscale("log")
    place.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    place.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    place.xaxis.set_minor_formatter(NullFormatter())
    place.set_xlabel("seconds a shape", fontsize=8)
    place.set_title(f"{clean(table.data['name'])}, {input_}", fontsize=8, parse_math=False)
    place.tick_params(labelsize=7, which="both")
    lowest = min([table.chance[measure], *(judged[name].low for name in points if name in judged)])
    place.set_ylim(max(0.0, lowest - 0.06), 1.02)
    place.grid(alpha=0.25, lw=0.5)
    for side in ("top", "right"):
        place.spines[side].set_visible(False)


def _label(place: Axes, points: dict[str, tuple[float, float]], titles: dict[str, str]) -> None:
    """Number the points, and name the numbers below: names beside the points would cover each other."""
    ordered = sorted(points, key=lambda name: (points[name], name))
    for number, name in enumerate(ordered, 1):
        place.annotate(str(number), points[name], fontsize=4.8, color="white", ha="center", va="center", zorder=4)
    named = [f"{number} {_short(titles[name])}" for number, name in enumerate(ordered, 1)]
    third = -(-len(named) // 3)
    for column in range(3):
        text = "\n".join(named[column * third : (column + 1) * third])
        place.text(
            column / 3, -0.24, text, transform=place.transAxes, fontsize=5.5, va="top", color="0.25", parse_math=False
        )


def _short(title: str) -> str:
    return title if len(title) <= _LONGEST else f"{title[: _LONGEST - 1]}…"

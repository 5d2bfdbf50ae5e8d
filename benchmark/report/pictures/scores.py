"""Scores of a table with their intervals, and what they cost, a line for each method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.ticker import LogLocator, NullFormatter

from benchmark.api.contracts import Input
from benchmark.report.content import Row, TableContent
from benchmark.report.pictures.cost import COLOURS, MEASURE
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Inches of a line, and of what is above and below all of them; of the tallest figure.
_LINE, _FRAME, _TALLEST = 0.165, 0.75, 8.4

#: Mark of an input among costs, and the same as a character.
_MARKS: dict[Input, tuple[str, str]] = {"mesh": ("o", "\u25cf"), "view": ("x", "\u00d7")}

#: Costs so far apart have room for powers of ten alone on the axis.
_WIDE = 10

#: Characters of a title.
_LONGEST = 44

_SIZE = 7


def scores_figure(table: TableContent, width: float, measure: str = MEASURE) -> Figure | None:
    """Draw a panel for each input of a table, and one of seconds a shape; None for a table without scores.

    Filled are the best row and those that cannot be told from it.

    Parameters
    ----------
    table
        The table.
    width
        Inches.
    measure
        What is shown.
    """
    from matplotlib.figure import Figure

    rows = _scored(table)
    if not rows:
        return None
    figure = Figure(figsize=(width, min(_FRAME + _LINE * len(rows), _TALLEST)), dpi=300, layout="constrained")
    axes = figure.subplots(1, len(table.inputs) + 1, sharey=True, squeeze=False)[0]
    for place, input_ in zip(axes, table.inputs, strict=False):
        _scores(place, table, input_, measure)
        place.set_title(input_, fontsize=_SIZE + 1)
        place.set_xlabel(measure, fontsize=_SIZE)
    _costs(axes[-1], rows, table.inputs)
    titles = [_short(clean(row.label)) for row in rows]
    axes[0].set_yticks(range(len(rows)), titles, parse_math=False)
    axes[0].set_ylim(len(rows) - 0.4, -0.6)
    for place in axes:
        place.tick_params(labelsize=_SIZE)
        place.tick_params(axis="y", length=0)
        place.grid(alpha=0.25, lw=0.5)
        for side in ("top", "right", "left"):
            place.spines[side].set_visible(False)
    return figure


def _scored(table: TableContent) -> list[Row]:
    return [row for row in table.rows if any(cell.scores for cell in row.cells.values())]


def _scores(place: Axes, table: TableContent, input_: Input, measure: str) -> None:
    for k, row in enumerate(_scored(table)):
        cell, judged = row.cells.get(input_), table.significance.get((row.method, input_, measure))
        if cell is None or not cell.scores:
            continue
        colour = COLOURS.get(row.family, COLOURS["extended"])
        leads = judged is not None and (judged.is_best or judged.is_inseparable)
        if judged is not None:
            place.plot([judged.low, judged.high], [k, k], color=colour, lw=1, alpha=0.6)
        place.plot(cell.scores[measure], k, "o", ms=4, color=colour, mfc=colour if leads else "white", mew=0.9)
    place.axvline(table.chance[measure], color="0.6", lw=0.8, ls=(0, (4, 3)), zorder=0)
    place.set_xlim(0, 1.02)
    place.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])


def _costs(place: Axes, rows: Sequence[Row], inputs: Sequence[Input]) -> None:
    known: list[float] = []
    for input_ in inputs:
        found = [(row.cells[input_].seconds, k) for k, row in enumerate(rows) if input_ in row.cells]
        points = [(seconds, k) for seconds, k in found if seconds]
        known += [seconds for seconds, _ in points]
        place.plot([seconds for seconds, _ in points], [k for _, k in points], _MARKS[input_][0], ms=3, color="0.3")
    place.set_xscale("log")
    place.set_title(", ".join(f"{_MARKS[input_][1]} {input_}" for input_ in inputs), fontsize=_SIZE + 1)
    place.set_xlabel("seconds a shape", fontsize=_SIZE)
    place.xaxis.set_minor_formatter(NullFormatter())
    if known:
        place.set_xlim(min(known) / 2, max(known) * 2)
        place.xaxis.set_major_locator(LogLocator(subs=(1.0,) if max(known) > _WIDE * min(known) else (1.0, 2.0, 5.0)))
        place.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _short(title: str) -> str:
    return title if len(title) <= _LONGEST else f"{title[: _LONGEST - 1]}\u2026"

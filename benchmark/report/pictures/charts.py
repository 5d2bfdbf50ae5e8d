"""Charts for papers: accuracy against cost, scores, robustness, precision over recall, classes and confusions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, PercentFormatter

from benchmark.api.contracts import Input
from benchmark.datasets.changes import CHANGES
from benchmark.errors import ConfigurationError
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.escaping import number
from benchmark.report.pictures.forms import WIDTH
from benchmark.report.pictures.painting import save
from benchmark.report.rankings import (
    CLASSES,
    RECALLS,
    RankedCell,
    classes_of,
    costs_and_scores,
    pareto_front,
    ranked_cells,
)
from benchmark.report.robustness import file_stem, titles
from benchmark.report.significance import CONTROL
from benchmark.text import clean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

#: Measure on the axis of scores.
MEASURE = "DCG"

#: Colour and mark of each family of methods; other families use those of "extended".
_FAMILIES = {"paper": ("#2f6fb7", "o"), "extended": ("#2a9d8f", "D"), CONTROL: ("#b0772e", "s")}

#: Mark of each input in the chart of costs, and the same as a character.
_INPUT_MARKS: dict[Input, tuple[str, str]] = {"mesh": ("o", "\u25cf"), "view": ("x", "\u00d7")}

#: Sizes in inches: a panel of costs without names; heights of a row of scores, of the margins around the rows, and of
#: the tallest figure.
_COST = (3.5, 2.4)
_LINE, _FRAME, _TALLEST = 0.165, 0.75, 8.4

_SIZE = 7
_TEXT: Mapping[str, Any] = {"parse_math": False}
_MARKERS = "os^vD<>p*hXP"

#: Maximum number of confusion matrices, and of those side by side; of curves side by side; of classes with legible
#: names.
_MOST_PANELS, _PANELS, _CURVES, _MOST_NAMES = 12, 4, 4, 40


def cost_figure(table: TableContent, measure: str = MEASURE) -> Figure:
    """Draw a panel for each input of a table: a measure with its interval against total seconds per shape.

    Controls are drawn, but excluded from the Pareto front.

    Raises
    ------
    ConfigurationError
        If no row has scores and a cost.
    """
    points = {input_: costs_and_scores(table, input_, measure) for input_ in table.inputs}
    inputs = [input_ for input_ in table.inputs if points[input_]]
    if not inputs:
        raise ConfigurationError("no row of the table has scores and a cost", "run its methods here")
    n_lines = -(-max(len(points[input_]) for input_ in inputs) // 3)
    figure, axes = _panels(table, inputs, 0.1 * n_lines, "seconds a shape", measure)
    for place, input_ in zip(axes, inputs, strict=True):
        _cost_panel(place, table, input_, measure, points[input_])
    return figure


def _panels(
    table: TableContent, inputs: Sequence[Input], height: float, x_label: str, y_label: str
) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with a titled panel for each input, higher by so many inches for a legend below."""
    figure = Figure(figsize=(_COST[0] * len(inputs), _COST[1] + height), dpi=300, layout="constrained")
    axes = figure.subplots(1, len(inputs), squeeze=False, sharey=True)[0]
    axes[0].set_ylabel(y_label, fontsize=8)
    for place, input_ in zip(axes, inputs, strict=True):
        place.set_title(f"{clean(table.data['name'])}, {input_}", fontsize=8, **_TEXT)
        place.set_xlabel(x_label, fontsize=8)
        _plain_frame(place, "top", "right")
    return figure, axes


def _cost_panel(
    place: Axes, table: TableContent, input_: Input, measure: str, points: Mapping[str, tuple[float, float]]
) -> None:
    lines = {line.method: line for line in table.lines if line.input == input_}
    front = pareto_front(costs_and_scores(table, input_, measure, with_controls=False))
    if front:
        seconds, scores = zip(*(points[name] for name in front), strict=True)
        place.step(seconds, scores, where="post", color="#2f6fb7", lw=1.2, zorder=1)
    lows = [table.chance[measure]]
    for name, (cost, score) in points.items():
        colour, mark = _FAMILIES.get(lines[name].family, _FAMILIES["extended"])
        if judged := table.judged(lines[name]).get(measure):
            place.plot([cost] * 2, [judged.low, judged.high], color=colour, lw=0.7, alpha=0.35)
            lows.append(judged.low)
        edge = "black" if name in front else "none"
        place.plot(cost, score, mark, color=colour, markersize=8, mec=edge, mew=0.9, zorder=3)
    # Names next to the points would overlap, so points are numbered, with a legend below.
    names = []
    for order, name in enumerate(sorted(points, key=lambda name: (points[name], name)), 1):
        place.annotate(str(order), points[name], fontsize=4.8, color="white", ha="center", va="center", zorder=4)
        names.append(f"{order} {_shortened(clean(lines[name].title), 20)}")
    third = -(-len(names) // 3)
    for column in range(3):
        text = "\n".join(names[column * third : (column + 1) * third])
        place.annotate(
            text, (column / 3, 0), (0, -32), xycoords="axes fraction", textcoords="offset points", fontsize=5.5,
            va="top", color="0.25", **_TEXT,
        )  # fmt: skip
    place.axhline(table.chance[measure], color="0.6", lw=0.7, ls=(0, (4, 3)), zorder=0)
    _log_axis(place, (1.0, 2.0, 5.0))
    place.set_ylim(max(0.0, min(lows) - 0.06), 1.02)


def _scores_panel(place: Axes, table: TableContent, rows: Sequence[Any], input_: Input) -> None:
    for height, row in enumerate(rows):
        line = table.line(row.method, input_)
        if line is None or not line.scores:
            continue
        colour, judged = _FAMILIES.get(row.family, _FAMILIES["extended"])[0], table.judged(line).get(MEASURE)
        leads = judged is not None and (judged.is_best or judged.is_inseparable)
        if judged is not None:
            place.plot([judged.low, judged.high], [height, height], color=colour, lw=1, alpha=0.6)
        place.plot(line.scores[MEASURE], height, "o", ms=4, color=colour, mfc=colour if leads else "white", mew=0.9)
    place.axvline(table.chance[MEASURE], color="0.6", lw=0.8, ls=(0, (4, 3)), zorder=0)
    place.set_xlim(0, 1.02)
    place.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
    place.set_title(input_, fontsize=_SIZE + 1)
    place.set_xlabel(MEASURE, fontsize=_SIZE)


def _costs_panel(place: Axes, table: TableContent, rows: Sequence[Any]) -> None:
    known: list[float] = []
    inputs = table.inputs
    for input_ in inputs:
        lines = [(table.line(row.method, input_), height) for height, row in enumerate(rows)]
        points = [(line.seconds, height) for line, height in lines if line is not None and line.seconds]
        known += [seconds for seconds, _ in points]
        place.plot([seconds for seconds, _ in points], [k for _, k in points], _INPUT_MARKS[input_][0], ms=3, c="0.3")
    place.set_xscale("log")
    if known:
        place.set_xlim(min(known) / 2, max(known) * 2)
        _log_axis(place, (1.0,) if max(known) > 10 * min(known) else (1.0, 2.0, 5.0))
    place.set_title(", ".join(f"{_INPUT_MARKS[input_][1]} {input_}" for input_ in inputs), fontsize=_SIZE + 1)
    place.set_xlabel("seconds a shape", fontsize=_SIZE)


def draw_curves(frames: Sequence[DataFrame], folder: Path) -> None:
    """Write a picture of curves for each data set and input."""
    for frame in frames:
        save(curves_figure(frame), folder / f"{file_stem(frame)}.png")


def curves_figure(frame: DataFrame) -> Figure:
    """Draw NN over the strength of each perturbation, starting from clean data."""
    n_curves = frame["perturbation"].nunique()
    columns = min(_CURVES, n_curves + 1)
    rows = -(-(n_curves + 1) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.8 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    looks = {method: look | {"markersize": 3, "linewidth": 1} for method, look in _looks(titles(frame)).items()}
    for place, (perturbation, part) in zip(axes, frame.groupby("perturbation", sort=False), strict=False):
        known = CHANGES[str(perturbation)]
        for method, curve in part.groupby("method", sort=False):
            values = [curve["clean_NN"].iloc[0], *curve["NN"].astype(float)]
            place.plot(range(len(values)), values, **looks[str(method)])
        place.axhline(part["chance"].iloc[0], color="grey", linestyle=":", linewidth=1)
        place.set_title(known.title, fontsize=9)
        place.set_xlabel(known.unit, fontsize=7)
        place.set_xticks(range(len(known.amounts) + 1), ["clean", *(f"{a:g}" for a in known.amounts)], fontsize=7)
        place.set_xlim(-0.2, len(known.amounts) + 0.2)
        place.set_ylim(-0.03, 1.03)
        place.tick_params(labelsize=7)
    for place in axes[n_curves:]:
        place.axis("off")
    legend = axes[n_curves]
    for method, title in titles(frame).items():
        legend.plot([], [], label=title.replace("$", r"\$"), **looks[method])
    legend.plot([], [], color="grey", linestyle=":", linewidth=1, label="chance")
    legend.legend(fontsize=6, loc="center", ncols=2 if len(looks) > 12 else 1, frameon=False)
    figure.supylabel("NN", fontsize=9)
    return figure


def precision_recall_figure(table: TableContent, artefacts: ArtefactReader) -> Figure:
    """Draw a panel for each input of a table: interpolated precision over recall, the mean over all queries.

    Raises
    ------
    ConfigurationError
        If no distances are stored.
    """
    curves = [(cell, precision) for cell in ranked_cells(table, artefacts) if (precision := cell.precision())]
    inputs = _inputs(cell for cell, _ in curves)
    looks = _looks(dict.fromkeys(cell.line.method for cell, _ in curves))
    n_lines = -(-len(looks) // len(inputs) // 2)
    figure, axes = _panels(table, inputs, 0.14 * n_lines, "recall", "precision")
    for place in axes:
        place.set_xlim(0, 1.02)
        place.set_ylim(0, 1.03)
    for cell, precision in curves:
        place = axes[inputs.index(cell.line.input)]
        place.plot(RECALLS, precision, lw=1, ms=2.5, label=cell.line.method, **looks[cell.line.method])
    handles = {label: line for place in axes for line, label in zip(*place.get_legend_handles_labels(), strict=True)}
    names = {cell.line.method: _shortened(clean(cell.line.title), 34).replace("$", r"\$") for cell, _ in curves}
    figure.legend(
        [handles[name] for name in looks], [names[name] for name in looks],
        loc="outside lower center", ncols=2 * len(inputs), fontsize=5.5, frameon=False,
    )  # fmt: skip
    return figure


def classes_figure(table: TableContent, artefacts: ArtefactReader) -> Figure:
    """Draw a panel for each input of a table: the mean DCG over the queries of each class, by method."""
    cells = ranked_cells(table, artefacts)
    inputs, classes = _inputs(cells), classes_of(cells)
    counts = [sum(cell.line.input == input_ for cell in cells) for input_ in inputs]
    size = (WIDTH, min(0.8 * len(inputs) + 0.14 * sum(counts), _TALLEST))
    figure = Figure(figsize=size, dpi=300, layout="constrained")
    axes = figure.subplots(len(inputs), 1, squeeze=False, height_ratios=counts)[:, 0]
    for place, input_ in zip(axes, inputs, strict=True):
        shown = [cell for cell in cells if cell.line.input == input_]
        values = np.array([cell.by_class(classes)[MEASURE] for cell in shown], dtype=float)
        image = _heat_map(place, values, classes, [_shortened(clean(cell.line.title), 34) for cell in shown])
        place.set_title(f"{MEASURE}, {input_}", fontsize=_SIZE + 1)
        if len(classes) <= _MOST_NAMES // 2:
            for line, column in np.argwhere(np.isfinite(values)):
                value = values[line, column]
                shade = "white" if value > 0.6 else "black"
                place.text(column, line, number(value), fontsize=4.5, ha="center", va="center", color=shade)
    figure.colorbar(image, ax=axes, fraction=0.02, pad=0.01).ax.tick_params(labelsize=_SIZE - 1)
    return figure


def confusion_figure(table: TableContent, artefacts: ArtefactReader) -> Figure:
    """Draw a panel for each method: classes of queries as rows, those of their nearest matches as columns.

    Raises
    ------
    ConfigurationError
        If no distances are stored.
    """
    cells = ranked_cells(table, artefacts)
    names = classes_of(cells)
    counted = ((cell, cell.confusion(CLASSES, names)) for cell in cells)
    panels = [*islice(((cell, counts) for cell, counts in counted if counts.any()), _MOST_PANELS)]
    _inputs(cell for cell, _ in panels)
    columns = min(_PANELS, len(panels))
    rows, side = -(-len(panels) // columns), WIDTH / max(columns, 2)
    figure = Figure(figsize=(side * columns, (side + 0.15) * rows), dpi=300, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for place in axes[len(panels) :]:
        place.axis("off")
    for order, (place, (cell, counts)) in enumerate(zip(axes, panels, strict=False)):
        values = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        image = _heat_map(place, values, names, names if order % columns == 0 else [])
        place.set_title(f"{_shortened(clean(cell.line.title), 20)}, {cell.line.input}", fontsize=_SIZE, **_TEXT)
    bar = figure.colorbar(image, ax=axes, fraction=0.02, pad=0.01, format=PercentFormatter(1))
    bar.ax.tick_params(labelsize=_SIZE - 1)
    figure.supylabel("query", fontsize=_SIZE)
    figure.supxlabel("nearest match", fontsize=_SIZE)
    return figure


def _inputs(cells: Iterable[RankedCell]) -> list[Input]:
    """Return the inputs of some rows; raise ``ConfigurationError`` if there are none."""
    inputs = list(dict.fromkeys(cell.line.input for cell in cells))
    if not inputs:
        raise ConfigurationError("no distances of the table are stored here", "run its methods here")
    return inputs


def _heat_map(place: Axes, values: Any, columns: Sequence[str], rows: Sequence[str]) -> Any:
    """Draw values from 0 to 1, without names if they would be illegible."""
    image = place.imshow(values, vmin=0, vmax=1, cmap="YlGnBu", aspect="auto", interpolation="nearest")
    for axis, names in ((place.xaxis, columns), (place.yaxis, rows)):
        shown = [_shortened(clean(name), 34) for name in names] if len(names) <= _MOST_NAMES else []
        axis.set_ticks(range(len(shown)), shown, **_TEXT)
    place.tick_params(labelsize=5.5, length=0)
    place.tick_params(axis="x", rotation=90)
    return image


def _looks(methods: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return colour and mark of the line of each method."""
    colours = mpl.colormaps["tab20"].colors  # type: ignore[attr-defined]
    pairs = zip(methods, cycle(colours), cycle(_MARKERS), strict=False)
    return {method: {"color": colour, "marker": mark} for method, colour, mark in pairs}


def _log_axis(place: Axes, steps: Sequence[float]) -> None:
    place.set_xscale("log")
    place.xaxis.set_major_locator(LogLocator(subs=steps))
    place.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    place.xaxis.set_minor_formatter(NullFormatter())


def _plain_frame(place: Axes, *hidden: str) -> None:
    place.tick_params(labelsize=_SIZE, which="both")
    place.grid(alpha=0.25, lw=0.5)
    for side in hidden:
        place.spines[side].set_visible(False)


def _shortened(title: str, most: int) -> str:
    """Shorten a long title, first by omitting names of parameters."""
    title = title if len(title) <= most else re.sub(r"[\w-]+=", "", title)
    return title if len(title) <= most else f"{title[: most - 1]}\u2026"

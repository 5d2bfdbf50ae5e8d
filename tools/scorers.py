"""Figure of two-scorers.csv, which results/experiments/two_scorers.py writes: python -m tools.scorers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame, read_csv

from benchmark.protocols.tables import TITLES
from benchmark.report.figures import COLOURS, COLUMN, GREY, MEASURE, save, subplots

TARGET = Path(__file__).parents[1] / "results" / "figures" / "two-scorers.png"


def scorers_figure(scores: DataFrame) -> Figure:
    """Draw the scores of each method by both scorers, with intervals over classes."""
    figure, ((place,),) = subplots(COLUMN, 2.4)
    of_measure = scores[(scores["measure"] == MEASURE) & (scores.get("input", "mesh") == "mesh")].sort_values(
        "method", key=lambda names: names.map([*TITLES].index)
    )
    for number, (scorer, part) in enumerate(of_measure.groupby("scorer", sort=False)):
        errors = np.abs(part[["low", "high"]].to_numpy().T - part["value"].to_numpy())
        rows = np.arange(len(part)) + 0.15 * (2 * number - 1)
        place.errorbar(part["value"], rows, xerr=errors, fmt="os"[number], ms=3, elinewidth=0.7, label=scorer,
                       color=(COLOURS["form"], GREY)[number])  # fmt: skip
    methods = list(of_measure["method"].unique())
    place.set_yticks(range(len(methods)), [TITLES.get(method, method) for method in methods])
    place.invert_yaxis()
    place.set_xlabel(MEASURE)
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=7)
    return figure


if __name__ == "__main__":
    save(scorers_figure(read_csv(TARGET.with_suffix(".csv"))), TARGET)

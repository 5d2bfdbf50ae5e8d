"""Figure of the paper's methods under two scorers, from results/figures/two-scorers.csv: python -m tools.scorers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame, read_csv

from benchmark.protocols.tables import TITLES
from benchmark.report.figures import COLUMN, MEASURE, save, subplots

TARGET = Path(__file__).parents[1] / "results" / "figures" / "two-scorers.png"


def scorers_figure(scores: DataFrame) -> Figure:
    """Draw the scores of each method by both scorers with intervals over classes; crossing lines change order."""
    scorers = list(dict.fromkeys(scores["scorer"]))
    figure, ((place,),) = subplots(COLUMN, 2.6)
    for number, (method, of_method) in enumerate(scores[scores["measure"] == MEASURE].groupby("method", sort=False)):
        part = of_method.set_index("scorer").loc[scorers]
        places, values = np.arange(len(scorers)) + 0.02 * (number - 3.5), part["value"].to_numpy()
        errors = np.abs(part[["low", "high"]].to_numpy().T - values)
        line = place.errorbar(places, values, errors, marker="o", ms=3, lw=1, elinewidth=0.5)
        place.annotate(TITLES.get(str(method), str(method)), (places[-1], values[-1]), (4, -2), fontsize=5,
                       textcoords="offset points", color=line[0].get_color())  # fmt: skip
    place.set_xticks(range(len(scorers)), scorers)
    place.set(xlim=(-0.3, len(scorers) - 0.4), ylabel=MEASURE)
    return figure


if __name__ == "__main__":
    save(scorers_figure(read_csv(TARGET.with_suffix(".csv"))), TARGET)

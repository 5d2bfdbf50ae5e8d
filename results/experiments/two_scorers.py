"""Scores of the paper's methods on TOSCA by two scorers: ``python
results/experiments/two_scorers.py [RESULTS]``.

Writes results/figures/two-scorers.csv, with intervals over classes, from records of ``run -t III -d
tosca``, with and without ``--scorer spherical-harmonics --plugin examples/spherical_harmonics.py``;
published ones are of CM-BOF alone."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas

from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.reference.paper import CLASSICAL, PAPER_MEASURES
from benchmark.report.statistics import class_intervals

RESULTS = Path(__file__).parents[1]
SCORERS = ("cm-bof", "spherical-harmonics")


def lines(record: Record) -> pandas.DataFrame:
    """Return a line for each measure of a record."""
    values = np.array([record.per_query[name] for name in PAPER_MEASURES], dtype=np.float64).T
    low, high = class_intervals(values, record.labels).T
    scores = [record.scores[name] for name in PAPER_MEASURES]
    table = pandas.DataFrame({"measure": PAPER_MEASURES, "value": scores, "low": low, "high": high})
    return table.assign(input=record.input, method=record.method, scorer=record.scorer)


if __name__ == "__main__":
    found = [
        record
        for record in read_records(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS)
        if record.gallery == "tosca" and record.method in CLASSICAL and record.scorer in SCORERS
    ]
    found.sort(key=lambda record: (record.input, SCORERS.index(record.scorer), record.method))
    columns = ["input", "method", "scorer", "measure", "value", "low", "high"]
    table = pandas.concat([*map(lines, found)])[columns].round(6)
    table.to_csv(RESULTS / "figures" / "two-scorers.csv", index=False, lineterminator="\n")

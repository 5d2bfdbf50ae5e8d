"""How much the weights that are ours move scores: each is halved and doubled, one at a time.

    python results/experiments/sensitivity.py run RESULTS [METHOD ...]   # it resumes
    python results/experiments/sensitivity.py judge RESULTS              # writes sensitivity.csv

The rule is in README.md beside this file, under "Weights of ours". CANONICAL_FORMS_DATA names the
folder of TOSCA. Rows with our weights are the published ones; what is not published runs, too.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmark.api.parameters import format_value
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.registry import select_one
from benchmark.report.notation import signed_hundredths
from benchmark.report.rivals import DRAW_ERRORS, SAME
from benchmark.report.statistics import ALPHA, sign_flip_test

#: Weights that the sources do not give, by method.
WEIGHTS = {
    "constrained-mds": ("first_pull", "last_pull"),
    "feature-preserved": ("parts", "seam"),
    "mesh-unfolding": ("first_stiffness", "strain_bound"),
    "sd-gdm": ("count",),
}

FACTORS = (0.5, 2)

#: TOSCA, and one draw of people.
DATA = ("tosca", "people[draw=1]")

#: Scorers of the rows: none for a descriptor, or that of the published rows.
SCORERS = ("", "cm-bof")

PUBLISHED = Path(__file__).parents[1]
TABLE = Path(__file__).with_name("sensitivity.csv")


def variants(method: str) -> Iterator[tuple[str, str, float]]:
    """Yield the name of each variant of a method, the weight that it changes, and the factor."""
    defaults = select_one(method).defaults
    for weight in WEIGHTS[method]:
        for factor in FACTORS:
            value = type(defaults[weight])(factor * defaults[weight])
            yield f"{method}[{weight}={format_value(value)}]", weight, factor


def run(results: Path, *methods: str) -> None:
    """Score all variants, and our weights where no published record has them."""
    for data in DATA:
        known = {of.method for of in records_of(PUBLISHED, data)}
        for method in methods or WEIGHTS:
            names = [name for name, _, _ in variants(method)]
            if method not in known:
                names.append(method)
            words = ["-d", data, "--input", "mesh", "-j", "1", "--results", str(results)]
            for name in names:
                words += ["-m", name]
            subprocess.run([sys.executable, "-m", "benchmark", "run", *words], check=True)


def records_of(folder: Path, data: str) -> list[Record]:
    """Return the records of a results folder that rank all complete surfaces of a data set.

    Those of another scorer or seed are left out, so that each method has one.
    """
    found = []
    for record in read_records(folder):
        is_of_data = record.gallery == data and record.input == "mesh"
        is_like_published = record.scorer in SCORERS and record.seed == 0
        if is_of_data and is_like_published and record.status == "ok":
            found.append(record)
    return found


def queries(record: Record) -> np.ndarray:
    """Return the measures of the queries, shape (N, 4)."""
    return np.array([record.per_query[name] for name in PAPER_MEASURES]).T


def codebook_errors(record: Record) -> np.ndarray:
    """Return the standard errors of scores over draws of the codebook; 0 for a descriptor."""
    if not record.scorer:
        return np.zeros(len(PAPER_MEASURES))
    return np.array([(record.draw_errors or DRAW_ERRORS)[name] for name in PAPER_MEASURES])


def changes(ours: Record, other: Record) -> pd.DataFrame:
    """Return the scores of a variant beside those with our weights, by measure.

    A change is significant if p < .05 for these two rows alone, over whole classes and the four
    measures, and above the scatter if it exceeds twice its standard error over codebooks.
    """
    gains = queries(other) - queries(ours)
    errors = np.array([codebook_errors(ours), codebook_errors(other)])
    change = gains.mean(axis=0)
    return pd.DataFrame(
        {
            "measure": PAPER_MEASURES,
            "ours": queries(ours).mean(axis=0),
            "change": change,
            "p": sign_flip_test(gains, ours.labels),
            "above_scatter": np.abs(change) > 2 * np.sqrt((errors**2).sum(axis=0)) + SAME,
        }
    )


def judge(results: Path) -> None:
    """Write what each change of a weight does, and print a table of it.

    Raises ``SystemExit`` before all changes have run.
    """
    found = []
    missing = []
    for data in DATA:
        known = {of.method: of for of in records_of(PUBLISHED, data)}
        known |= {of.method: of for of in records_of(results, data)}
        for method in WEIGHTS:
            for name, weight, factor in variants(method):
                lacking = [f"{data} {row}" for row in (method, name) if row not in known]
                missing += lacking
                if not lacking:
                    table = changes(known[method], known[name])
                    place = {"data": data, "method": method, "weight": weight, "factor": factor}
                    found.append(table.assign(**place))
    if missing:
        raise SystemExit(f"these rows have not run: {', '.join(dict.fromkeys(missing))}")
    table = pd.concat(found)[["data", "method", "weight", "factor", *found[0].columns[:5]]]
    table.to_csv(TABLE, index=False, float_format="%.6f", lineterminator="\n")
    print("\n".join(lines(table)))


def lines(table: pd.DataFrame) -> list[str]:
    """Return the changes as lines of a table in Markdown; bold where a weight matters."""
    said = ["| data | method, weight | half: NN FT ST DCG | double |", "|---|---|---|---|"]
    for (data, method, weight), group in table.groupby(["data", "method", "weight"], sort=False):
        cells = [" ".join(map(text, of.itertuples())) for _, of in group.groupby("factor")]
        said.append(f"| {data} | {method}, {weight} | {' | '.join(cells)} |")
    return said


def text(change: Any) -> str:
    """Return a change with its sign; bold if it is significant and above the scatter."""
    signed = signed_hundredths(change.change)
    return f"**{signed}**" if change.p < ALPHA and change.above_scatter else signed


if __name__ == "__main__":
    verb, folder, *names = sys.argv[1:]
    {"run": run, "judge": judge}[verb](Path(folder), *names)

"""How often the test of the tables finds a difference of .2 between two forms, on TOSCA.

The rule: 600 times, two of the published forms of Table III (and of III-view) are drawn. Both are
made equally good: in each class, they are exchanged with a probability of one half. Then .2 is
added to all queries of the first (a score may so exceed 1). All other rows stay. Found is what has
p < .05 in the test of all rows and measures, without regard to the scatter of codebooks.

    python results/experiments/power.py         # writes power.csv beside it, in half a minute
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.pipeline.record_files import read_records
from benchmark.report.statistics import ALPHA, class_sums, permutation_test
from benchmark.report.tables import table_views

HERE = Path(__file__).parent

#: Pairs of forms that are drawn.
DRAWS = 600

#: What is added to each score of one of them.
DIFFERENCE = 0.2

SEED = 6


def main() -> None:
    """Simulate both tables, and write the shares that are found."""
    records = read_records(HERE.parent, local=False)
    lines = []
    for view in table_views(records, ["III"], datasets=["tosca"]):
        title = view.columns[0].title
        rows = view.tests[title, "form"].rivals.values()
        sums, sizes = zip(*(class_sums(row.values, row.labels) for row in rows), strict=True)
        shares = found_shares(np.stack(sums, axis=1) / 1e6, sizes[0])
        of_measures = dict(zip(view.measures, shares.tolist(), strict=True))
        facts = {"table": view.table.identifier, "classes": len(sizes[0]), "forms": len(sums)}
        lines.append({**facts, "draws": DRAWS, **of_measures})
    pd.DataFrame(lines).to_csv(HERE / "power.csv", index=False, float_format="%.4f")


def found_shares(sums: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return in which share of draws the difference is found, by measure.

    Parameters
    ----------
    sums
        Measures summed over the queries of each class, shape (classes, rows, measures).
    sizes
        Queries of each class.
    """
    generator = np.random.default_rng(SEED)
    n_classes, n_rows, _ = sums.shape
    found = []
    for _ in range(DRAWS):
        first, second = generator.permutation(n_rows)[:2]
        exchanged = generator.random(n_classes) < 0.5
        drawn = sums.copy()
        drawn[exchanged, first] = sums[exchanged, second]
        drawn[exchanged, second] = sums[exchanged, first]
        drawn[:, first] += DIFFERENCE * sizes[:, None]
        p_values = permutation_test(np.moveaxis(drawn, 1, 0), range(n_classes))
        found.append(p_values[first, second] < ALPHA)
    return np.mean(found, axis=0)


if __name__ == "__main__":
    main()

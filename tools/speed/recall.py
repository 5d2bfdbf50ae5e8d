"""Share of the nearest forms that an index finds: ``python -m tools.speed.recall "humans[subjects=20,poses=10]"``.

Forms by classic MDS and the shapes themselves are one gallery. The share of the entries of the vectors that is kept and
the candidates for each neighbour were chosen by it on that set, which no table uses.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.scoring import SignatureArrays
from benchmark.datasets.catalogue import open_dataset
from benchmark.jobs.method_run import MethodRun, features_of
from benchmark.jobs.preparation import Preparation
from benchmark.methods.registry import methods
from benchmark.report.escaping import markdown_table
from benchmark.storage.store import Store
from retrieval import clock_index
from retrieval.clock_index import ClockIndex
from retrieval.cmbof import CMBOF
from retrieval.neighbours import candidates

MEASURED = Path(__file__).parents[2] / "results" / "recall.json"
KEPT = (1.0, 0.7, 0.5, 0.3, 0.2, 0.1)
NEIGHBOURS = (1, 5, 10, 20)
CANDIDATES = (2, 5, 10)


def signatures(dataset: str, names: list[str], results: Path, most: int | None) -> Iterator[SignatureArrays]:
    """Yield the signatures of the first forms of a set by some methods; they stay in a results folder."""
    store, opened = Store.open(results), open_dataset(dataset, None)
    for name in names:
        work = MethodRun(Preparation(opened, "mesh", store), store, methods()[name])
        yield from (features_of(work.treat(entry)) for entry in opened.entries[:most])


def recalls(index: ClockIndex, exact: np.ndarray) -> Iterator[str]:
    """Yield the share of the K nearest that is found among so many candidates for each, of either shape of a pair."""
    count = len(exact)
    for k in NEIGHBOURS:
        last = np.sort(exact, axis=1)[:, k - 1 : k]
        for each in CANDIDATES:
            chosen = np.zeros((count, count), dtype=bool)
            np.put_along_axis(chosen, candidates(index, k * each), values=True, axis=1)
            found = np.sort(np.where(chosen | chosen.T, exact, np.inf), axis=1)[:, :k]
            yield f"{(found <= last).mean():.3f}"


def main() -> None:
    """Print the table, and keep it for the page on scale."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset")
    parser.add_argument("--most", type=int, help="shapes of the set, the first ones")
    parser.add_argument("-m", nargs="+", default=["classic-mds", "identity"], help="methods")
    parser.add_argument("--results", type=Path, default=Path("build/recall"), help="where forms are kept")
    options: Any = parser.parse_args()
    gallery = list(signatures(options.dataset, options.m, options.results, options.most))
    index = ClockIndex.of(CMBOF(), gallery, 0)
    everybody = np.arange(len(index))
    exact = np.array([index.distances(np.full(len(index), form), everybody) for form in everybody])
    np.fill_diagonal(exact, np.inf)
    body = []
    for kept in KEPT:
        clock_index.KEPT = kept
        body.append([f"{kept}", *recalls(ClockIndex.from_arrays(index.to_arrays()), exact)])
    head = ["kept", *(f"{k}: {k * each}" for k in NEIGHBOURS for each in CANDIDATES)]
    table = markdown_table(head, body, n_left=0)
    known = json.loads(MEASURED.read_text()) if MEASURED.exists() else {}
    known[f"{len(index)} forms of {options.dataset} by {', '.join(options.m)}"] = table
    MEASURED.write_text(json.dumps(known, indent=1) + "\n")
    print("\n".join(table))


if __name__ == "__main__":
    main()

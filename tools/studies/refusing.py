"""What a method would gain or lose by refusing shapes: the tallest tenth, the worst hubs, a whole class.

    python -m tools.studies.refusing RESULTS [--data-root DIR]

reads the distances of the jobs in a results folder and prints a table. A shape that is refused is a query with 0 in
every measure, and stands behind all others as a target.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.report.escaping import markdown_table
from benchmark.results import ResultsFolder, open_results
from retrieval.metrics import evaluate

MEASURES = ("NN", "FT", "ST", "DCG")


def tallest(results: ResultsFolder, key: str, shapes: list[str]) -> list[int]:
    """Places of the tenth of the shapes whose prepared surfaces are the longest."""
    record = results._scored(key)
    dataset = results._artefacts.dataset(record)
    entries = {entry.identifier: entry for entry in dataset.entries}
    surfaces = [results._artefacts.surface(record, entries[name]) for name in shapes]
    sizes = [0.0 if each is None else float(np.ptp(each.vertices, axis=0).max()) for each in surfaces]
    return np.argsort(sizes, kind="stable")[::-1][: len(shapes) // 10].tolist()


def hubs(matrix: NDArray[Any], labels: list[str], count: int) -> list[int]:
    """Places of the shapes that are most often the nearest neighbour of a query of another class."""
    far = matrix + np.diag(np.full(len(matrix), np.inf))
    nearest = far.argmin(axis=1)
    wrong = Counter(int(found) for query, found in enumerate(nearest) if labels[query] != labels[found])
    return [place for place, _ in wrong.most_common(count)]


def scores(matrices: NDArray[Any], labels: list[str], refused: list[int]) -> NDArray[Any]:
    """NN, FT, ST and DCG, the mean over the draws of the scorer."""
    answered = [place for place in range(len(labels)) if place not in refused]
    found = [evaluate(matrix[np.ix_(answered, answered)], labels, answered=answered) for matrix in matrices]
    return np.mean([[each.means[name] for name in MEASURES] for each in found], axis=0)


def main() -> None:
    """Print a table with a line for each job."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--data-root", type=Path)
    options = parser.parse_args()
    results = open_results(options.results, data_root=options.data_root)
    records = results.records()
    head = ["gallery, input", "method", "all answered", "tallest tenth", "worst hubs (a tenth)", "a class"]
    body = []
    for key, row in records[records["status"] == "ok"].iterrows():
        try:
            matrices = results.distance_matrices(str(key))
        except Exception:  # noqa: S112 - made elsewhere
            continue
        queries = results.queries(str(key))
        labels, shapes = queries["subject"].tolist(), queries["shape"].tolist()
        smallest = min(set(labels), key=lambda name: (labels.count(name), name))
        chosen = {
            "none": [],
            "tallest": tallest(results, str(key), shapes),
            "hubs": hubs(matrices.mean(axis=0), labels, len(labels) // 10),
            "class": [place for place, label in enumerate(labels) if label == smallest],
        }
        cells = [" ".join(f"{value:.2f}" for value in scores(matrices, labels, refused)) for refused in chosen.values()]
        body.append([f"{row['gallery']}, {row['input']}", row["method"], *cells])
    print("\n".join(markdown_table(head, body, len(head))))


if __name__ == "__main__":
    main()

"""What a published table of retrieval scores can be, given the sizes of its classes: ``python -m tools.plausible``.

Three floors for NN, first tier, second tier and DCG. *Chance*: a random order. *Bound*: the least mean DCG of rankings
with the printed NN and tiers, from the weights of the ranks alone; where the printed DCG lies below it, the row is
impossible. *Pose first*: simulated galleries in which a shape is the vector of its pose plus that of its class, and
pose dominates; searches move these vectors to make a measure low. A row below it is implausible for such a gallery, not
impossible.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from benchmark.reference.paper import CLASSICAL, MEASURES, PRINTED
from retrieval.measures import chance_levels

#: Strengths of pose relative to class, dimensions of the vectors, and steps of each search, one a measure.
STRENGTHS, DIMENSIONS, STEPS = (3.0, 10.0), (1, 2, 3), 2000

#: Half a unit of the last printed decimal.
ROUNDING = 0.005


def measures(relevant: NDArray[np.bool_], n_relevant: int) -> NDArray[np.float64]:
    """Return NN, FT, ST and DCG of rankings, shape (N, 4), from the relevance of their results, shape (N, results)."""
    weights = 1 / np.log2(np.maximum(np.arange(1, relevant.shape[1] + 1), 2))
    tiers = [relevant[:, : k * n_relevant].sum(axis=1) / n_relevant for k in (1, 2)]
    gain = (relevant * weights).sum(axis=1) / weights[:n_relevant].sum()
    return np.column_stack([relevant[:, 0], *tiers, gain])


def least_dcg(scores: Mapping[str, float], n_classes: int, size: int) -> float:
    """Return the least mean DCG of rankings with these NN, FT and ST: all other hits at the end of their tiers."""
    count, wanted = n_classes * size - 1, size - 1
    weights = 1 / np.log2(np.maximum(np.arange(1, count + 1), 2))
    nn, first, second = (max(scores[name] - ROUNDING, 0.0) for name in MEASURES[:3])
    hits = [nn, max(first * wanted - nn, 0.0), max((second - first) * wanted, 0.0)]
    ends = [1, wanted, min(2 * wanted, count)]
    gain, left = 0.0, float(wanted)
    for number, end in zip(hits, ends, strict=True):
        gain += _worst(weights, number, end)
        left -= number
    return (gain + _worst(weights, max(left, 0.0), count)) / float(weights[:wanted].sum())


def _worst(weights: NDArray[np.float64], hits: float, end: int) -> float:
    """Return the least weight of some hits up to a rank, the last one of which may be a share of queries."""
    whole = int(hits)
    last = weights[max(end - whole - 1, 0)] * (hits - whole)
    return float(weights[max(end - whole, 0) : end].sum() + last)


def pose_first(n_classes: int, size: int, steps: int = STEPS) -> NDArray[np.float64]:
    """Return the least mean measures that searches find; all classes have the same poses."""
    random, least = np.random.default_rng(0), np.full(len(MEASURES), np.inf)
    for strength, dimension, measure in product(STRENGTHS, DIMENSIONS, range(1, len(MEASURES))):
        vectors = strength * random.normal(size=(size, dimension)), random.normal(size=(n_classes, dimension))
        scores = simulated(*vectors)
        for _ in range(steps):
            poses, classes = vectors[0].copy(), vectors[1].copy()
            part, step = ((poses, strength), (classes, 1.0))[random.integers(2)]
            part[random.integers(len(part))] += step * random.choice([0.03, 0.3, 1.0]) * random.normal(size=dimension)
            moved = simulated(poses, classes)
            if moved[measure] <= scores[measure]:
                vectors, scores = (poses, classes), moved
        least = np.minimum(least, scores)
    return least


def simulated(poses: NDArray[np.float64], classes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean measures of the gallery of all poses, shape (size, d), of all classes, shape (n, d)."""
    labels = np.repeat(np.arange(len(classes)), len(poses))
    shapes = np.tile(poses, (len(classes), 1)) + classes[labels]
    distances = cdist(shapes, shapes)
    np.fill_diagonal(distances, np.inf)
    order = np.argsort(distances, axis=1)[:, :-1]
    return np.asarray(measures(labels[order] == labels[:, None], len(poses) - 1).mean(axis=0))


def report(rows: Mapping[str, Mapping[str, float]], n_classes: int, size: int, steps: int = STEPS) -> list[str]:
    """Return the floors of a gallery, and each row with what it lies below."""
    floor = pose_first(n_classes, size, steps)
    random = chance_levels(np.arange(n_classes).repeat(size))
    lines = [f"{n_classes} classes of {size} shapes", _line("random order", [random[m] for m in MEASURES])]
    lines.append(_line("pose first, as low as found", floor))
    for name, scores in rows.items():
        below = [m for m, least in zip(MEASURES, floor, strict=True) if scores[m] + ROUNDING < least]
        impossible = scores["DCG"] + ROUNDING < least_dcg(scores, n_classes, size)
        verdict = "impossible" if impossible else f"below in {', '.join(below)}" if below else ""
        lines.append(f"{_line(name, [scores[m] for m in MEASURES])}  {verdict}".rstrip())
    return lines


def _line(name: str, values: Sequence[float] | NDArray[np.float64]) -> str:
    return f"{name:<32}{' '.join(f'{value:.2f}'.removeprefix('0') for value in values)}"


def main() -> None:
    """Print the floors beside the classical rows of a table of the paper."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", choices=["I", "II", "III"], default="I")
    parser.add_argument("--classes", type=int, default=5)
    parser.add_argument("--size", type=int, default=20, help="shapes in each class")
    given = parser.parse_args()
    rows = {name: PRINTED[given.table][name] for name in CLASSICAL}
    print("\n".join(report(rows, given.classes, given.size)))


if __name__ == "__main__":
    main()

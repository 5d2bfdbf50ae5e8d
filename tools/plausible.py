"""What a published table of retrieval scores can be, given the sizes of its classes: ``python -m tools.plausible``.

Three floors for NN, first tier, second tier and DCG. *Chance*: a random order. *Bound*: the least mean DCG of rankings
with the printed NN and tiers, from the weights of the ranks alone; where the printed DCG lies below it, the row is
impossible. *Pose first*: simulated galleries whose distances are driven by pose, as adversely as is plausible: the
least of the draws. A row below it is implausible for such a gallery, not impossible.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from itertools import cycle, islice, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from benchmark.reference.paper import CLASSICAL, MEASURES, PRINTED

#: Simulated galleries. In each, a shape is the vector of its pose, times the size of its class, plus the vector of its
#: class; these are the strengths of pose relative to class, the spreads of sizes (as logarithms), and dimensions.
DRAWS, STRENGTHS, SPREADS, DIMENSIONS = 6000, (1.0, 3.0, 10.0), (0.0, 0.2, 0.5), (1, 2, 8)

#: Half a unit of the last printed decimal.
ROUNDING = 0.005


def measures(relevant: NDArray[np.bool_], n_relevant: int) -> NDArray[np.float64]:
    """Return NN, FT, ST and DCG of rankings, shape (N, 4), from the relevance of their results, shape (N, results)."""
    weights = 1 / np.log2(np.maximum(np.arange(1, relevant.shape[1] + 1), 2))
    tiers = [relevant[:, : k * n_relevant].sum(axis=1) / n_relevant for k in (1, 2)]
    gain = (relevant * weights).sum(axis=1) / weights[:n_relevant].sum()
    return np.column_stack([relevant[:, 0], *tiers, gain])


def chance(n_classes: int, size: int) -> NDArray[np.float64]:
    """Return the expected measures of a random order."""
    count, wanted = n_classes * size - 1, size - 1
    weights = 1 / np.log2(np.maximum(np.arange(1, count + 1), 2))
    share = wanted / count
    return np.array(
        [share, share, min(2 * wanted, count) * share / wanted, share * weights.sum() / weights[:wanted].sum()]
    )


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


def pose_first(n_classes: int, size: int, draws: int = DRAWS) -> NDArray[np.float64]:
    """Return the least mean measures over simulated galleries; see :data:`DRAWS`. All classes have the same poses."""
    generator, least = np.random.default_rng(0), np.full(len(MEASURES), np.inf)
    classes, poses = np.divmod(np.arange(n_classes * size), size)
    for strength, spread, dimension in islice(cycle(product(STRENGTHS, SPREADS, DIMENSIONS)), draws):
        sizes = np.exp(spread * generator.normal(size=(n_classes, 1)))
        shapes = strength * sizes[classes] * generator.normal(size=(size, dimension))[poses]
        shapes += generator.normal(size=(n_classes, dimension))[classes]
        distances = cdist(shapes, shapes)
        np.fill_diagonal(distances, np.inf)
        order = np.argsort(distances, axis=1)[:, :-1]
        least = np.minimum(least, measures(classes[order] == classes[:, None], size - 1).mean(axis=0))
    return least


def report(rows: Mapping[str, Mapping[str, float]], n_classes: int, size: int, draws: int = DRAWS) -> list[str]:
    """Return the floors of a gallery, and each row with what it lies below."""
    floor = pose_first(n_classes, size, draws)
    lines = [f"{n_classes} classes of {size} shapes", _line("random order", chance(n_classes, size))]
    lines.append(_line("pose first, least of the draws", floor))
    for name, scores in rows.items():
        below = [m for m, least in zip(MEASURES, floor, strict=True) if scores[m] + ROUNDING < least]
        impossible = scores["DCG"] + ROUNDING < least_dcg(scores, n_classes, size)
        verdict = "impossible" if impossible else f"below in {', '.join(below)}" if below else ""
        lines.append(f"{_line(name, [scores[m] for m in MEASURES])}  {verdict}".rstrip())
    return lines


def _line(name: str, values: Sequence[float] | NDArray[np.float64]) -> str:
    return f"{name:<32}{' '.join(f'{value:.2f}'.removeprefix('0') for value in values)}"


def main() -> None:
    """Print the floors beside the classical rows of a table of the paper, or beside NN FT ST DCG given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", choices=["I", "II", "III"], default="I")
    parser.add_argument("--classes", type=int, default=5)
    parser.add_argument("--size", type=int, default=20, help="shapes in each class")
    parser.add_argument("--row", nargs=4, type=float, metavar=MEASURES, help="instead of a table of the paper")
    parser.add_argument("--draws", type=int, default=DRAWS)
    given = parser.parse_args()
    rows = {name: PRINTED[given.table][name] for name in CLASSICAL}
    rows = {"given": dict(zip(MEASURES, given.row, strict=True))} if given.row else rows
    print("\n".join(report(rows, given.classes, given.size, given.draws)))


if __name__ == "__main__":
    main()

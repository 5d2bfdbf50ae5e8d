"""Compare two methods, by measure and by query, and two scorers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.changes import last_change
from benchmark.pipeline.storage.records import DEFAULT_SCORER, Place, Record, by_place, scorer_name
from benchmark.report.escaping import number
from benchmark.report.significance import (
    ALPHA,
    class_permutation_test,
    intervals,
    least_class_probability,
    permutation_test,
    queries_of,
)
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from pandas import DataFrame

#: Scores that differ by at most this value count as equal.
_SMALLEST = 5e-7

#: Maximum number of pairs shown in full, and of pairs shown with a line each.
_IN_FULL, _FIRST_SCREEN = 3, 20

_LEGEND = (
    "In brackets: 95 % intervals of the differences over resampled classes. p: for other poses of these subjects "
    "(paired permutation test over queries); classes: for other subjects (test over whole classes)."
)


@dataclass(frozen=True, eq=False)
class Difference:
    """Comparison of two records.

    Parameters
    ----------
    where
        Gallery, input and other facts that both share.
    measures
        By printed measure: scores of the ``first`` and the ``second`` record; ``low`` and ``high``, the 95 % interval
        over resampled classes of the difference between the means over common queries; and its unadjusted p-values, for
        other ``poses`` of these subjects and for other ``subjects``.
    gains
        Gain of the second record for each common query, a column for each measure.
    n_classes
        Number of classes of these queries.
    is_perturbed
        Whether the data set is perturbed.
    """

    where: str
    measures: DataFrame
    gains: NDArray[np.float64]
    n_classes: int
    is_perturbed: bool

    @property
    def changed(self) -> int:
        """Number of queries for which a measure differs."""
        return int(np.count_nonzero(self.gains.any(axis=1)))

    @property
    def is_empty(self) -> bool:
        """Whether all scores are equal, on average and for every query."""
        return not self.changed and (self.measures["second"] - self.measures["first"]).abs().max() <= _SMALLEST


@dataclass(frozen=True)
class Comparison:
    """All pairs of corresponding records, and the records of only one side."""

    differences: tuple[Difference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]


def compare_methods(records: Iterable[Record], first: str, second: str, scorer: str = DEFAULT_SCORER) -> Comparison:
    """Compare two methods on all galleries and inputs for which both have scores; descriptors match any scorer."""
    sides: dict[str, dict[str, Record]] = {first: {}, second: {}}
    for place, record in _newest(records).items():
        if place.method in sides and scorer_name(record) in (scorer, ""):
            seed = f" seed {place.seed}" if place.seed else ""
            sides[place.method][f"{place.gallery} {place.input}{seed}"] = record
    return _compare(sides[first], sides[second])


def _newest(records: Iterable[Record]) -> dict[Place, Record]:
    """Return the newest record with scores of each place."""
    scored = (record for record in records if record["status"] == "ok")
    return {place: rivals[-1] for place, rivals in by_place(scored).items()}


def _compare(first: Mapping[str, Record], second: Mapping[str, Record]) -> Comparison:
    both = [where for where in first if where in second and {*first[where]["shapes"]} & {*second[where]["shapes"]}]
    return Comparison(
        tuple(_difference(where, first[where], second[where]) for where in both),
        tuple(where for where in first if where not in both),
        tuple(where for where in second if where not in both),
    )


def _difference(where: str, first: Record, second: Record) -> Difference:
    """Test the differences of single queries, one column per measure; classes are resampled as a whole."""
    from pandas import DataFrame

    gains, labels = queries_of([[first], [{**second, "gallery": first["gallery"]}]]).gains(0, 1)
    low, high = intervals(gains, labels).T
    columns = {"first": [first["scores"][name] for name in PRINTED], "low": low, "high": high}
    columns |= {"second": [second["scores"][name] for name in PRINTED], "poses": permutation_test(gains)}
    columns["subjects"] = class_permutation_test(gains, labels)
    is_perturbed = last_change(first["data"]["name"]) is not None
    return Difference(where, DataFrame(columns, PRINTED), gains, len(set(labels)), is_perturbed)


def lines(comparison: Comparison, first: str, second: str, *, everything: bool = True) -> list[str]:
    """Return a comparison as lines of text; pairs without a difference are only counted.

    Parameters
    ----------
    comparison
        The comparison.
    first, second
        Names of the two sides.
    everything
        Whether to print all pairs in full. Otherwise, if there are more than a few, print a line for each of the first,
        clean data first, and count the others.
    """
    different = [pair for pair in comparison.differences if not pair.is_empty]
    n_pairs = len(comparison.differences)
    counted = [f"{n_pairs - len(different)} of {n_pairs} pairs are equal"]
    if not everything and len(different) > _IN_FULL:
        shown = sorted(different, key=lambda pair: pair.is_perturbed)[:_FIRST_SCREEN]
        more = f"{len(different) - len(shown)} more pairs differ; " if len(different) > len(shown) else ""
        hint = f"{more}--all shows intervals and tests; -d and --input choose"
        return [*_overview(shown, first, second), *counted, *_alone(comparison, first, second), hint]
    in_full = [line for pair in different for line in _in_full(pair, first, second)]
    alone = _alone(comparison, first, second, everything=everything)
    return [*in_full, *counted, *alone, *([_LEGEND] if different else [])]


def _in_full(pair: Difference, first: str, second: str) -> list[str]:
    """Return a heading, and a line for each measure: both scores, interval, tests, and queries won by each side."""
    gain = pair.gains[:, -1]
    text = [
        f"{pair.where}: {pair.changed} of {len(gain)} queries changed, {np.count_nonzero(gain > 0)} better, "
        f"{np.count_nonzero(gain < 0)} worse in {PRINTED[-1]}"
    ]
    for name, row in pair.measures.iterrows():
        holds = [f"other {kind}" for kind in ("poses", "subjects") if row[kind] < ALPHA]
        better = second if row["second"] > row["first"] else first
        text.append(
            f"  {name:<3}  {number(row['first'], 3)} -> {number(row['second'], 3)}  "
            f"{_signed(row['second'] - row['first'])}  ({_signed(row['low'])} to {_signed(row['high'])})  "
            f"p {number(row['poses'], 4)}  classes {number(row['subjects'], 4)}"
            + (f"  {better} is better for {' and '.join(holds)}" if holds else "")
        )
    if (least := least_class_probability(pair.n_classes)) >= ALPHA:
        text.append(
            f"  with {pair.n_classes} classes, no p over classes is below {number(least, 4)}, so they say "
            "nothing about other subjects"
        )
    return text


def _overview(pairs: Sequence[Difference], first: str, second: str) -> list[str]:
    """Return a heading with the measures, and a line for each pair."""
    width = max(len(pair.where) for pair in pairs)
    text = [f"{'':<{width}}  queries" + "".join(f"  {name:<14}" for name in PRINTED).rstrip()]
    for pair in pairs:
        cells = [
            f"{number(row['first'])} {_signed(row['second'] - row['first'])}{'*' if row['poses'] < ALPHA else ' '}"
            for _, row in pair.measures.iterrows()
        ]
        figures = "".join(f"  {cell:<14}" for cell in cells).rstrip()
        text.append(f"{pair.where:<{width}}  {len(pair.gains):>7}{figures}")
    legend = f"{first}, and the difference to {second}; *: p < {ALPHA:.2f} for other poses of these subjects."
    return [*text, legend]


def _alone(comparison: Comparison, first: str, second: str, *, everything: bool = False) -> list[str]:
    """Name the records of only one side, or the first of many."""
    text = []
    for name, alone in ((first, comparison.only_first), (second, comparison.only_second)):
        if everything or len(alone) <= _IN_FULL:
            text += [f"only {name}: {where}" for where in alone]
        else:
            text.append(f"only {name}: {len(alone)} more, the first is {alone[0]}; --all names them")
    return text


def _signed(value: float) -> str:
    """Format a number with a sign and three decimals."""
    text = number(value, 3)
    return text if text.startswith("-") else f"+{text}"

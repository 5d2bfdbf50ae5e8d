"""Differences between two sets of records, measure by measure and query by query."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.datasets.jittered import parsed_jitter
from benchmark.datasets.perturbations.dataset import parsed
from benchmark.pipeline.storage.merging import told
from benchmark.pipeline.storage.records import DEFAULT_SCORER, Place, Record, by_place, scorer_name
from benchmark.report.rounding import number
from benchmark.report.statistics.queries import queries_of
from benchmark.report.statistics.significance import (
    class_permutation_test,
    intervals,
    least_class_probability,
    permutation_test,
)
from retrieval.measures import PRINTED

#: Smallest difference of a score that counts.
_SMALLEST = 5e-7

#: Pairs that are always shown in full, and pairs that a first screen has lines for.
_IN_FULL, _FIRST_SCREEN = 3, 20

#: Probability below which an overview marks a difference.
_LEVEL = 0.05


@dataclass(frozen=True)
class Difference:
    """Two records that can be compared.

    Parameters
    ----------
    where
        What they have in common.
    first, second
        Scores of each by printed measure.
    intervals
        By measure: 95 % interval of the difference of means over the queries that both have, classes drawn anew.
    probabilities
        By measure: of so large a difference of means if there were none for other poses of these subjects; of one pair,
        not adjusted.
    class_probabilities
        The same for other subjects.
    n_classes
        Classes of the queries that both have.
    changed
        Queries for which a measure differs.
    better, worse
        Queries for which the second one has a higher, and a lower, DCG.
    n_queries
        Queries that both have.
    is_perturbed
        Whether the shapes are those of a set under a perturbation.
    """

    where: str
    first: Mapping[str, float]
    second: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    probabilities: Mapping[str, float]
    class_probabilities: Mapping[str, float]
    n_classes: int
    changed: int
    better: int
    worse: int
    n_queries: int
    is_perturbed: bool = False

    @property
    def largest(self) -> float:
        """Largest difference of a printed measure."""
        return max(abs(self.second[name] - self.first[name]) for name in self.first)


@dataclass(frozen=True)
class Comparison:
    """All pairs of records that belong together, and what only one side has."""

    differences: tuple[Difference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]


def compare_folders(first: Iterable[Record], second: Iterable[Record]) -> Comparison:
    """Compare the newest records with scores of each gallery, input, method and seed."""
    return _compare(*({told(record): record for record in _newest(side).values()} for side in (first, second)))


def compare_methods(records: Iterable[Record], first: str, second: str, scorer: str = DEFAULT_SCORER) -> Comparison:
    """Compare two methods on every gallery and input that both have scores for; a descriptor needs no scorer."""
    newest = {where: record for where, record in _newest(records).items() if scorer_name(record) in (scorer, "")}

    def of(method: str) -> dict[str, Record]:
        return {
            f"{where.gallery} {where.input}{f' seed {where.seed}' if where.seed else ''}": record
            for where, record in newest.items()
            if where.method == method
        }

    return _compare(of(first), of(second))


def _newest(records: Iterable[Record]) -> dict[Place, Record]:
    """The newest record with scores of each place; jittered preparations have none."""
    scored = (record for record in records if record["status"] == "ok" and not parsed_jitter(record["data"]["name"]))
    return {where: rivals[-1] for where, rivals in by_place(scored).items()}


def _compare(first: Mapping[str, Record], second: Mapping[str, Record]) -> Comparison:
    both = [where for where in first if where in second]
    return Comparison(
        tuple(_difference(where, first[where], second[where]) for where in both),
        tuple(where for where in first if where not in second),
        tuple(where for where in second if where not in first),
    )


def _difference(where: str, first: Record, second: Record) -> Difference:
    """Test the differences of single queries, one column a measure; those of one class are drawn together."""
    here, there = queries_of([first], PRINTED), queries_of([second], PRINTED)
    shapes = {shape for _, shape in there.names}
    both = [name for name in here.names if name[1] in shapes]
    here, there = here.among(both), there.among((second["gallery"], shape) for _, shape in both)
    gains = np.column_stack([there.values[name] - here.values[name] for name in PRINTED])
    gain = gains[:, -1]
    ends = [(low, high) for low, high in intervals(gains, here.labels).tolist()]
    return Difference(
        where,
        {name: first["scores"][name] for name in PRINTED},
        {name: second["scores"][name] for name in PRINTED},
        dict(zip(PRINTED, ends, strict=True)),
        dict(zip(PRINTED, permutation_test(gains).tolist(), strict=True)),
        dict(zip(PRINTED, class_permutation_test(gains, here.labels).tolist(), strict=True)),
        len(set(here.labels)),
        int(np.count_nonzero(gains.any(axis=1))),
        int(np.count_nonzero(gain > 0)),
        int(np.count_nonzero(gain < 0)),
        len(gains),
        is_perturbed=parsed(first["data"]["name"]) is not None,
    )


def lines(comparison: Comparison, first: str, second: str, *, everything: bool = True) -> list[str]:
    """Write a comparison as text; pairs without a difference are counted only.

    Parameters
    ----------
    comparison
        What was compared.
    first, second
        Names of the two sides.
    everything
        Whether each pair has a head and a line for each measure however many there are. Otherwise, where there are
        more than a few, the first have a line each, clean data first, and the others are counted.
    """
    said: list[str] = []
    different = [pair for pair in comparison.differences if pair.changed or pair.largest > _SMALLEST]
    if not everything and len(different) > _IN_FULL:
        return _overview(comparison, different, first, second)
    for pair in different:
        said.append(
            f"{pair.where}: {pair.changed} of {pair.n_queries} queries changed, "
            f"{pair.better} better, {pair.worse} worse in {PRINTED[-1]}"
        )
        for name in pair.first:
            before, after = pair.first[name], pair.second[name]
            low, high = pair.intervals[name]
            said.append(
                f"  {name:<3}  {number(before, 3)} -> {number(after, 3)}  {_signed(after - before)}  "
                f"({_signed(low)} to {_signed(high)})  p {number(pair.probabilities[name], 4)}  "
                f"classes {number(pair.class_probabilities[name], 4)}{_better(pair, name, first, second)}"
            )
        if (least := least_class_probability(pair.n_classes)) >= _LEVEL:
            said.append(
                f"  with {pair.n_classes} classes no p over classes is below {number(least, 4)}: of other subjects "
                "nothing can be said"
            )
    said += _counted(comparison, different)
    said += _alone(comparison, first, second, everything=everything)
    if different:
        said.append(
            "In brackets: 95 % of the differences when classes are drawn anew. p: of so large a difference if there "
            "were none for other poses of these subjects (paired permutation test over queries); classes: the same for "
            "other subjects (test over whole classes)."
        )
    return said


def _better(pair: Difference, name: str, first: str, second: str) -> str:
    """Which side is better by a measure, and for what that holds; "" where neither test says so."""
    over = [
        what
        for what, found in (("other poses", pair.probabilities), ("other subjects", pair.class_probabilities))
        if found[name] < _LEVEL
    ]
    ahead = second if pair.second[name] > pair.first[name] else first
    return f"  {ahead} is better for {' and '.join(over)}" if over else ""


def _overview(comparison: Comparison, different: Sequence[Difference], first: str, second: str) -> list[str]:
    """A line for each of the first pairs, clean data first, and how to see the others."""
    shown = sorted(different, key=lambda pair: pair.is_perturbed)[:_FIRST_SCREEN]
    width = max(len(pair.where) for pair in shown)
    said = [f"{'':<{width}}  queries" + "".join(f"  {name:<14}" for name in PRINTED).rstrip()]
    for pair in shown:
        cells = [
            f"{number(pair.first[name])} {_signed(pair.second[name] - pair.first[name])}"
            f"{'*' if pair.probabilities[name] < _LEVEL else ' '}"
            for name in PRINTED
        ]
        said.append(f"{pair.where:<{width}}  {pair.n_queries:>7}" + "".join(f"  {cell:<14}" for cell in cells).rstrip())
    said.append(f"{first}, and how much {second} is above it; *: p < {_LEVEL:.2f} for other poses of these subjects.")
    said += _counted(comparison, different)
    said += _alone(comparison, first, second)
    hidden = len(different) - len(shown)
    said.append(
        f"{f'{hidden} more pairs differ; ' if hidden else ''}--all shows intervals and tests; -d and --input choose"
    )
    return said


def _counted(comparison: Comparison, different: Sequence[Difference]) -> list[str]:
    n_pairs = len(comparison.differences)
    return [f"{n_pairs - len(different)} of {n_pairs} pairs are equal"]


def _alone(comparison: Comparison, first: str, second: str, *, everything: bool = False) -> list[str]:
    """Name what only one side has, or the first of many."""
    said = []
    for name, alone in ((first, comparison.only_first), (second, comparison.only_second)):
        if everything or len(alone) <= _IN_FULL:
            said += [f"only {name}: {where}" for where in alone]
        else:
            said.append(f"only {name}: {len(alone)} more, the first is {alone[0]}; --all names them")
    return said


def _signed(value: float) -> str:
    """Three decimals with a sign."""
    text = number(value, 3)
    return text if text.startswith("-") else f"+{text}"

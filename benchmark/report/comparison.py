"""What differs between two sets of records, measure by measure and query by query."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from benchmark.storage.records import Record, by_place
from retrieval.measures import PRINTED

#: Smallest difference of a measure of one query that counts; records keep six decimals.
_SMALLEST = 5e-7


@dataclass(frozen=True)
class Difference:
    """Two records that can be compared.

    Parameters
    ----------
    where
        What they have in common.
    first, second
        Scores of each by measure.
    changed
        Queries for which a measure differs.
    better, worse
        Queries for which the second one has a higher, and a lower, DCG.
    n_queries
        Queries that both have.
    """

    where: str
    first: Mapping[str, float]
    second: Mapping[str, float]
    changed: int
    better: int
    worse: int
    n_queries: int

    @property
    def largest(self) -> float:
        """Largest difference of a printed measure."""
        return max(abs(self.second[name] - self.first[name]) for name in PRINTED)


@dataclass(frozen=True)
class Comparison:
    """All pairs of records that belong together, and what only one side has."""

    differences: tuple[Difference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]


def compare_folders(first: Iterable[Record], second: Iterable[Record]) -> Comparison:
    """Compare the newest records with scores of each gallery, input, method and seed."""
    return _compare(
        *({" ".join(map(str, where[:3])): found for where, found in _newest(part).items()} for part in (first, second))
    )


def compare_methods(records: Iterable[Record], first: str, second: str) -> Comparison:
    """Compare two methods on every gallery and input that both have scores for."""
    newest = _newest(records)

    def of(method: str) -> dict[str, Record]:
        return {f"{where[0]} {where[1]}": record for where, record in newest.items() if where[2] == method}

    return _compare(of(first), of(second))


def _newest(records: Iterable[Record]) -> dict[tuple[str, str, str, int], Record]:
    scored = (record for record in records if record["status"] == "ok")
    return {where: found[-1] for where, found in by_place(scored).items()}


def _compare(first: Mapping[str, Record], second: Mapping[str, Record]) -> Comparison:
    both = [where for where in first if where in second]
    return Comparison(
        tuple(_difference(where, first[where], second[where]) for where in both),
        tuple(where for where in first if where not in second),
        tuple(where for where in second if where not in first),
    )


def _difference(where: str, first: Record, second: Record) -> Difference:
    place = {shape: k for k, shape in enumerate(second["shapes"])}
    pairs = [(k, place[shape]) for k, shape in enumerate(first["shapes"]) if shape in place]

    def value(record: Record, name: str, k: int) -> float:
        found = record["per_query"][name][k]
        return 0.0 if found is None else float(found)

    def differences(name: str) -> list[float]:
        return [value(second, name, j) - value(first, name, i) for i, j in pairs]

    by_measure = {name: differences(name) for name in PRINTED}
    changed = sum(any(abs(d) > _SMALLEST for d in of_query) for of_query in zip(*by_measure.values(), strict=True))
    gain = by_measure["DCG"]
    return Difference(
        where,
        {name: first["scores"][name] for name in PRINTED},
        {name: second["scores"][name] for name in PRINTED},
        changed,
        sum(d > _SMALLEST for d in gain),
        sum(d < -_SMALLEST for d in gain),
        len(pairs),
    )


def lines(comparison: Comparison, first: str, second: str) -> list[str]:
    """A comparison as text, one line a pair; pairs without a difference are counted only."""
    different = [pair for pair in comparison.differences if pair.changed or pair.largest > _SMALLEST]
    width = max((len(pair.where) for pair in different), default=0)
    said = []
    for pair in different:
        figures = "  ".join(
            f"{name} {pair.first[name]:.3f} -> {pair.second[name]:.3f} ({pair.second[name] - pair.first[name]:+.3f})"
            for name in PRINTED
        )
        queries = f"{pair.changed} of {pair.n_queries} queries changed, {pair.better} better, {pair.worse} worse in DCG"
        said.append(f"{pair.where:<{width}}  {figures}  {queries}")
    same = len(comparison.differences) - len(different)
    said.append(f"{same} of {len(comparison.differences)} pairs are equal")
    said += [f"only {first}: {where}" for where in comparison.only_first]
    said += [f"only {second}: {where}" for where in comparison.only_second]
    return said

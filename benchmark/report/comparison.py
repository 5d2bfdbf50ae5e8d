"""Compare two methods query by query, on the galleries that both have ranked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.reference.paper import MEASURES
from benchmark.report.statistics import ALPHA, bootstrap_intervals, class_test, query_test
from benchmark.report.tables import query_measures, ranked_classes

LEGEND = (
    "In brackets: 95 % intervals of the differences over resampled classes. p over classes: does the difference hold "
    "for other subjects? p over queries: for other poses of these subjects?"
)


def compare(records: Iterable[Record], first: str, second: str) -> list[str]:
    """Return the comparison of two methods as lines of text: differences, intervals and tests by gallery and measure.

    Parameters
    ----------
    records
        The records that tables show, of one scorer and seed.
    first, second
        Names of the methods.

    Raises
    ------
    ConfigurationError
        If a method has no scores, or the two have no gallery in common, or ranked different shapes.
    """
    sides: dict[str, dict[tuple[str, str], Record]] = {first: {}, second: {}}
    scored = [record for record in records if record.status == "ok"]
    for record in scored:
        if record.method in sides:
            sides[record.method][record.gallery, record.input] = record
    for name, galleries in sides.items():
        if not galleries:
            known = ", ".join(sorted({record.method for record in scored}))
            raise ConfigurationError(f"{name} has no scores", f"run it, or choose among {known}")
    one, other = sides[first], sides[second]
    pairs = [(one[place], other[place]) for place in one if place in other]
    if not pairs:
        raise ConfigurationError(f"no gallery has scores of both {first} and {second}", "run both on one data set")
    lines, problems = [], []
    for pair in pairs:
        if pair[0].gallery_digest == pair[1].gallery_digest:
            lines += _lines(*pair)
        else:
            problems.append(_difference(*pair))
    if not lines:
        raise ConfigurationError(problems[0], "run both again on the same data")
    return [f"{first} -> {second}", *lines, *(f"not compared: {problem}" for problem in problems), LEGEND]


def _lines(first: Record, second: Record) -> list[str]:
    """Return a heading, and a line for each measure."""
    gains, labels = query_measures([second]) - query_measures([first]), ranked_classes(first.labels)
    changed = np.count_nonzero(np.abs(gains).max(axis=1) > 5e-7)
    lines = [f"{first.gallery}, {first.input}: {changed} of {len(gains)} queries differ"]
    tests = bootstrap_intervals(gains, labels, 0.95), class_test(gains, labels), query_test(gains)
    for name, (low, high), classes, queries in zip(MEASURES, *tests, strict=True):
        scores = first.scores[name], second.scores[name]
        better = (second if scores[1] > scores[0] else first).method
        verdict = f"  {better} is better for other subjects" if classes < ALPHA else ""
        change = f"{scores[1] - scores[0]:+.3f}  ({low:+.3f} to {high:+.3f})"
        tested = f"p over classes {classes:.4f}, over queries {queries:.4f}{verdict}"
        lines.append(f"  {name:<3}  {scores[0]:.3f} -> {scores[1]:.3f}  {change}  {tested}")
    n_classes = len(set(labels))
    if 2.0 ** (1 - n_classes) >= ALPHA:
        lines.append(f"  with {n_classes} classes, no p over classes is below {2.0 ** (1 - n_classes):.2f}")
    return lines


def _difference(first: Record, second: Record) -> str:
    """Say how the shapes of two records of one gallery differ."""
    texts = []
    for record, other in ((first, second), (second, first)):
        others = set(zip(other.shapes, other.labels, strict=True))
        alone = [shape for shape in zip(record.shapes, record.labels, strict=True) if shape not in others]
        if alone:
            names = ", ".join(name for name, _ in alone[:3])
            texts.append(f"only {record.method} has {names}{' ...' if len(alone) > 3 else ''}")
    what = "; ".join(texts) or "the files of some shapes have changed"
    counts = f"{len(first.shapes)} and {len(second.shapes)} shapes"
    return f"{first.gallery}, {first.input}: {first.method} and {second.method} ranked {counts}: {what}"

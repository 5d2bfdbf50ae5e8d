"""Compare two methods query by query, on the galleries that both have ranked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.reference.paper import MEASURES
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, bootstrap_intervals, least_p, tukey_test
from benchmark.report.tables import query_measures, ranked_classes, seen_classes

LEGEND = (
    "In brackets: 95 % intervals of the differences over resampled classes. p: randomised Tukey test of all measures, "
    "over whole classes; does the difference hold for other subjects?"
)


def compare(records: Iterable[Record], first: str, second: str) -> list[str]:
    """Return the comparison of two methods as lines of text: differences, intervals and a test by gallery and measure.

    Compared are the queries of classes on which neither was trained.

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
    legend = [LEGEND] if any("  p " in line for line in lines) else []
    return [f"{first} - {second}", *lines, *(f"not compared: {problem}" for problem in problems), *legend]


def _lines(first: Record, second: Record) -> list[str]:
    """Return a heading, and a line for each measure."""
    every, seen = ranked_classes(first), seen_classes(first) | seen_classes(second)
    judged = [place for place, label in enumerate(every) if label not in seen]
    values = np.array([query_measures([record])[judged] for record in (first, second)])
    labels, gains = [every[place] for place in judged], values[0] - values[1]
    differing = np.count_nonzero(np.abs(gains).max(axis=1, initial=0) > 5e-7)
    data, of = first.data, f" of {first.data.n_shapes}" if first.data.n_shapes else ""
    head = f"{first.gallery}, {first.input}: {differing} of {len(judged)} queries differ"
    head += f"; quick: {len(first.shapes)}{of} shapes" * data.quick
    head += f"; {len(every) - len(judged)} queries are of classes seen in training" * bool(seen)
    n_classes = len(set(labels))
    if n_classes < FEWEST_CLASSES:
        note = f"  not decidable: {n_classes} classes, of at least {FEWEST_CLASSES}"
    else:
        note = f"  with {n_classes} classes, no p is below {least_p(n_classes):.4f}"
    if not judged:
        return [head, note]
    lines, p_values = [head], tukey_test(values, labels)[0, 1]
    ends = bootstrap_intervals(gains, labels, 0.95)
    for name, (one, two), (low, high), p in zip(MEASURES, values.mean(axis=1).T, ends, p_values, strict=True):
        better = (first if one > two else second).method
        verdict = f"  {better} is better for other subjects" if p < ALPHA and not data.quick else ""
        tested = "" if np.isnan(p) else f"  ({low:+.3f} to {high:+.3f})  p {p:.4f}{verdict}"
        lines.append(f"  {name:<3}  {one:.3f} - {two:.3f} = {one - two:+.3f}{tested}")
    return [*lines, note]


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

"""Contradictions in records: fields of a record that cannot be true together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from benchmark.pipeline.records import RankedShapes, Record, key_at
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.text import counted

#: Most shapes of a gallery: a matrix of their distances has 20 GB.
MOST_SHAPES = 50_000

#: Most views of a shape.
MOST_VIEWS = 1000

#: Largest difference between a score and the mean of its values per query, which are rounded.
LARGEST_DIFFERENCE = 1e-6


def find_contradiction(record: Record) -> str:
    """Say which fields of a record contradict each other, or cannot be true; "" if none do.

    This finds records that were edited by hand, or put together wrongly.
    """
    for side in record.sides:
        fault = _fault_of_shapes(side)
        if fault:
            return fault
    fault = _fault_of_queries(record)
    if fault:
        return fault
    if record.status == "ok":
        return _fault_of_scores(record)
    if record.scores or record.per_query or record.draw_errors:
        return f"its status is '{record.status}', and it has scores"
    return ""


def _fault_of_queries(record: Record) -> str:
    """Say what is wrong with the queries of a record, and with its key; "" if nothing is."""
    if record.views != 1:
        return f"its queries have {record.views} views each"
    if record.result_key and record.key != key_at(record.result_key, record.row.paths):
        return "its key is not that of its result at its paths"
    strangers = {*record.seen} - {*record.shapes}
    if strangers:
        return f"a shape seen in training, '{min(strangers)}', is none of its shapes"
    if len({*record.sides[-1].labels}) == 1:
        return "its gallery has one class, so that every ranking is perfect"
    if not any(record.are_queries):
        return "no query has another shape of its class to find"
    return ""


def _fault_of_shapes(side: RankedShapes) -> str:
    """Say what is wrong with the lists of shapes, classes and files of queries or gallery.

    They must be of one length and within bounds. "" if nothing is wrong.
    """
    n_shapes = len(side.shapes)
    if not n_shapes:
        return "it has no shapes"
    if n_shapes > MOST_SHAPES:
        return f"it has {n_shapes:,} shapes, more than {MOST_SHAPES:,}"
    if side.views > MOST_VIEWS:
        return f"its shapes have {side.views:,} views each, more than {MOST_VIEWS:,}"
    if len(side.labels) != n_shapes:
        return f"it has {counted(n_shapes, 'shape')} and {counted(len(side.labels), 'label')}"
    fault = _fault_of_names(side)
    if fault:
        return fault
    for stage, keys in side.files.items():
        if len(keys) != n_shapes * side.views:
            return f"it has {counted(len(keys), 'file')} of {stage} for {n_shapes} shapes"
    if not side.gallery.startswith(side.data.name):
        return f"its gallery, '{side.gallery}', is not of its data set, '{side.data.name}'"
    return ""


def _fault_of_names(side: RankedShapes) -> str:
    """Say which name of a shape is listed twice, or in a list where it must not be; "" if none is.

    Unprepared shapes have to be among the refused ones, and these among the shapes.
    """
    refused = [name for name, _ in side.unsupported]
    lists = {"shape": side.shapes, "refused shape": refused, "unprepared shape": side.unprepared}
    for what, names in lists.items():
        repeated = _first_repeated(names)
        if repeated:
            return f"{what} '{repeated}' stands there twice"
    strangers = {*refused} - {*side.shapes}
    if strangers:
        return f"a refused shape, '{min(strangers)}', is none of its shapes"
    strangers = {*side.unprepared} - {*refused}
    if strangers:
        return f"an unprepared shape, '{min(strangers)}', is not refused"
    return ""


def _first_repeated(names: Sequence[str]) -> str | None:
    """Return the first name that occurs in a sequence twice; None if all differ."""
    counts = Counter(names)
    for name in names:
        if counts[name] > 1:
            return name
    return None


def _fault_of_scores(record: Record) -> str:
    """Say which scores of a record contradict its values per query; "" if none do."""
    # A shape whose class has no other shape to find is no query.
    are_queries = record.are_queries
    n_lone = are_queries.count(False)
    n_queries = are_queries.count(True)
    if record.lone_queries != n_lone:
        return f"it has {record.lone_queries} queries without a relevant shape, not {n_lone}"
    if record.tied_queries > n_queries:
        return f"it has {record.tied_queries} queries with ties among {n_queries}"
    for measure in PAPER_MEASURES:
        if measure not in record.scores or measure not in record.per_query:
            return f"it has no {measure}"
    for measure in (*record.per_query, *record.draw_errors):
        if measure not in record.scores:
            return f"it has values of {measure}, and no score"
    for measure in record.per_query:
        fault = _fault_of_measure(record, measure, are_queries)
        if fault:
            return fault
    return ""


def _fault_of_measure(record: Record, measure: str, are_queries: Sequence[bool]) -> str:
    """Say what is wrong with the values of one measure per query; "" if nothing is.

    Parameters
    ----------
    record
        The record.
    measure
        Name of the measure.
    are_queries
        Whether each shape has something to find; the others have no value.
    """
    values = record.per_query[measure]
    if len(values) != len(are_queries):
        return f"it has {len(are_queries)} queries and {counted(len(values), 'value')} of {measure}"
    if [value is not None for value in values] != list(are_queries):
        return f"{measure} is missing for a query, or there for a shape that is none"
    refused = {name for name, _ in record.unsupported}
    for shape, value in zip(record.shapes, values, strict=True):
        if value and shape in refused:
            return f"{measure} of a refused shape is not 0"
    values_of_queries = [value for value in values if value is not None]
    mean = sum(values_of_queries) / len(values_of_queries)
    score = record.scores[measure]
    if abs(mean - score) > LARGEST_DIFFERENCE:
        return f"{measure} is {score:.6f}, and the mean of its queries {mean:.6f}"
    return ""

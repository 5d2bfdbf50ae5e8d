"""Notes below a table: at most eight, one for each kind of fact."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from benchmark.reference.paper import MEASURES
from benchmark.text import brief

if TYPE_CHECKING:
    from benchmark.pipeline.records import Record
    from benchmark.report.tables import Row, TableView

#: Note on bold and italic.
MARKS = (
    "Bold: the best of its block. Italic: not separable from the best over subjects (paired bootstrap of classes, "
    "90 %). Rows with missing results or with shapes seen in training have neither."
)

#: Names in a list before the rest is only counted.
_NAMED = 3


def notes(view: TableView) -> list[str]:
    """Return the notes of a table."""
    rows = view.printed_rows
    found = (
        _columns(view), _failed(rows), _unreadable(rows), _refused(rows), _seen(rows), _missing(rows), _left_out(view),
        _published(rows), _joined(rows),
    )  # fmt: skip
    pointer = "How a method departs from its source: 'python -m benchmark describe METHOD'."
    marks = [MARKS] if view.marks else []
    return [*[*marks, *(note for part in found for note in part)][:7], pointer]


def _columns(view: TableView) -> Iterator[str]:
    """Say what the columns show."""
    parts = []
    if any(column.input == "as printed" for column in view.columns):
        parts.append("Complete surfaces; networks see one depth view.")
    for column in view.columns:
        of_rows = [one.records.values() for row in view.rows if (one := row.scored.get(column.title))]
        draws = max(of_rows, key=len, default=())
        if column.over_draws and len(draws) > 1:
            scores = [[records[0].scores[name] for records in of] for of in of_rows for name in MEASURES]
            apart = f"{max(max(of) - min(of) for of in scores):.2f}".removeprefix("0")
            parts.append(f"{column.title}: mean of {len(draws)} draws, whose scores are at most {apart} apart.")
    if parts:
        yield " ".join(parts)


def _failed(rows: Iterable[Row]) -> Iterator[str]:
    reasons: dict[str, list[str]] = {}
    for row in rows:
        for record in row.failed[:1]:
            reasons.setdefault(f"{record.status}: {brief(record.reason)}", []).append(row.title)
    if reasons:
        yield f"No result: {_listed(f'{_listed(titles)} ({reason})' for reason, titles in reasons.items())}."


def _unreadable(rows: Iterable[Row]) -> Iterator[str]:
    files = dict.fromkeys(shape for record in _records(rows) for shape in record.unprepared)
    if files:
        yield f"Cannot be read or prepared, and counts 0 in every row: {_listed(files)}."


def _refused(rows: Iterable[Row]) -> Iterator[str]:
    texts = []
    for row in rows:
        refused = {
            shape: reason
            for record in _records([row])
            for shape, reason in record.unsupported
            if shape not in record.unprepared
        }
        if refused:
            shape, reason = next(iter(refused.items()))
            texts.append(f"{row.title} {len(refused)} ({shape}: {brief(reason)})")
    if texts:
        yield f"Refused shapes, which count 0: {_listed(texts, '; ')}."


def _seen(rows: Iterable[Row]) -> Iterator[str]:
    texts = []
    for row in rows:
        for title, one in row.scored.items():
            count = len({(record.gallery, shape) for record in one.all_records for shape in record.seen})
            if count:
                total = len({(record.gallery, shape) for record in one.all_records for shape in record.shapes})
                texts.append(f"{row.title} {count} of {total} ({title})")
    if texts:
        yield f"Seen in training: {_listed(texts)}."


def _missing(rows: Iterable[Row]) -> Iterator[str]:
    texts = [f"{row.title} ({', '.join(one.missing)})" for row in rows for one in row.scored.values() if one.missing]
    if texts:
        yield f"Missing, and counts 0: {_listed(texts)}."


def _left_out(view: TableView) -> Iterator[str]:
    if view.left_out:
        yield f"Left out, because they rank another version of the data: {_listed(view.left_out)}; run them again."


def _published(rows: Iterable[Row]) -> Iterator[str]:
    """Name the rows that came with the suite, in a table that also has rows of runs here."""
    published = {row.title: next(iter(_records([row]))).commit for row in rows if row.scored and row.is_published}
    if published and any(row.scored and not row.is_published for row in rows):
        commits = ", ".join(sorted({commit[:8] for commit in published.values() if commit}))
        yield f"Published with the suite, not run here: {_listed(published)}" + (f" ({commits})." if commits else ".")


def _joined(rows: Iterable[Row]) -> Iterator[str]:
    notes = [record.notes for record in _records(rows)]
    bridges, gap = (max((of[name].max for of in notes if name in of), default=0) for name in ("bridges", "largest_gap"))
    if bridges > 0:
        across = f", across at most {gap:.2g} times the root of the area" if gap else ""
        yield f"Shapes of several pieces are joined, by at most {bridges:.0f} bridge{'s' * (bridges > 1)}{across}."


def _records(rows: Iterable[Row]) -> Iterator[Record]:
    return (record for row in rows for one in row.scored.values() for record in one.all_records)


def _listed(texts: Iterable[str], joint: str = ", ") -> str:
    """Join the first few of some texts, and count the others."""
    every = list(texts)
    more = [f"{len(every) - _NAMED} more"] if len(every) > _NAMED + 1 else []
    return joint.join([*every[: _NAMED if more else None], *more])

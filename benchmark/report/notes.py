"""Notes below a table, one for each kind of fact."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from pathlib import PurePath

import numpy as np

from benchmark.errors import short_reason
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROUND, Kind
from benchmark.reference.paper import MEASURES
from benchmark.report.columns import MEASURED
from benchmark.report.frames import hundredths
from benchmark.report.statistics import FEWEST_CLASSES
from benchmark.report.tables import BLOCKS, Row, TableView, least_difference
from benchmark.text import brief, listed

#: Classes that decide only large differences.
FEW_CLASSES = 10

#: Note on what few classes can decide, and on bold and italic.
FEW = "{} classes decide little: a difference of .2 in every class is found in about a quarter of cases at most. "
MARKS = (
    "Bold: the best of its block. Italic: not significantly worse (p at least .05; "
    "studentised permutation test over whole classes, of all rows and measures of the block). "
    "In parentheses: significantly worse, but within the scatter of codebooks and, for "
    "networks, of trainings. Rows that lack shapes, or with shapes seen in training, have no "
    "mark."
)


def table_notes(view: TableView) -> list[str]:
    """Return the notes of a table."""
    rows = view.printed_rows
    incomplete = [(row, one) for row in rows for one in row.scored.values() if one.missing]
    crossed = {
        title
        for title, records in view.samples.items()
        if (of := records[0].gallery_of_queries) and of.input == "mesh"
    }
    facts = {
        "{}": " ".join([view.by.note, *_columns(view)]).strip(),
        "No form of a surface: {}.": listed(
            r.title for r in rows if r.kind == "network" and crossed - {*r.scored}
        ),
        "No difference is significant and above the scatter: {}.": listed(_undecided(view)),
        "No result: {}.": listed(_failed(view, rows, crossed)),
        "Cannot be read or prepared, and count 0: {}.": listed(_unreadable(view, rows), "; "),
        "Refused shapes, which count 0: {}.": listed(_refused(rows), "; "),
        "Trained on the classes of: {}; they stay in the gallery, and decide no claim.": listed(
            _seen(rows)
        ),
        "Missing, and counts 0: {}.": listed(
            f"{row.title} ({', '.join(one.missing)})" for row, one in incomplete
        ),
        "Left out, because they rank another version of the data: {}; run them again.": listed(
            view.left_out
        ),
        "Ranks by spherical harmonics: {}.": _moves(view),
        "Published with the suite, not run here: {}.": _published(rows),
        "Merged from other results folders: {}.": listed(_merged(rows), "; "),
        "Trained with one seed, so no spread over seeds: {}.": listed(_trained_once(rows), "; "),
    }
    tested = [one.n_classes for one in view.tests.values()]
    fewest = min([n for n in tested if n >= FEWEST_CLASSES], default=0)
    marks = FEW.format(fewest) * (fewest <= FEW_CLASSES) + MARKS
    found = [marks] * bool(view.marks) + [
        words.format(text) for words, text in facts.items() if text
    ]
    return [*found, "How a method departs from its source: 'python -m benchmark describe METHOD'."]


def leads(view: TableView) -> list[str]:
    """Say for each column which row leads its block, and how many are significantly worse and above the scatter."""
    said: dict[str, list[str]] = {}
    for (title, kind), tested in view.tests.items():
        rivals = tested.rivals
        if tested.n_classes < FEWEST_CLASSES:
            said[title] = [f"{tested.n_classes} classes decide nothing here"]
            continue
        row, n_behind = block_lead(view, title, kind)
        score = f"{MEASURES[-1]} ({hundredths(rivals[row.method].means[MEASURES[-1]])}"
        worse = f"{n_behind or 'none'} of {len(rivals) - 1}"
        said.setdefault(title, []).append(
            f"{BLOCKS[kind]}: {row.title} scores highest in {score}; significantly worse, above the scatter: {worse})"
        )
    return [
        f"{title.capitalize()}. " * (len(view.columns) > 1) + "; ".join(of) + "."
        for title, of in said.items()
    ]


def block_lead(view: TableView, title: str, kind: Kind) -> tuple[Row, int]:
    """Return the best row of a block in a column, and how many are significantly worse, by more than the scatter."""
    tested = view.tests[title, kind]
    rivals, is_above = tested.rivals, tested.is_above_scatter
    best = max(rivals, key=lambda method: rivals[method].means[MEASURES[-1]])
    return next(row for row in view.rows if row.method == best), int(
        is_above[[*rivals].index(best), :, -1].sum()
    )


def _columns(view: TableView) -> Iterator[str]:
    """Say what the data are, and what the columns show."""
    if view.table.remark:
        yield view.table.remark
    if any(column.input == "as printed" for column in view.columns):
        yield "Complete surfaces; networks see one depth view unless named otherwise."
    if view.table.is_cross:
        yield "Queries rank the gallery without themselves; those of a class that it lacks are left out."
    if view.table.names == ROUND:
        yield "Cameras stand around each shape of the gallery, 30 degrees apart; its own camera is between two of them."
        yield "The nearest view counts. In training, networks of 128 px and extra data saw views of own cameras alone."
    if view.table.is_ablation:
        yield "The paper's row stands beside the network whose parts were left out, at 128 x 128 pixels."
    for column in view.columns:
        of_rows = {
            row.title: one.records.values()
            for row in view.rows
            if (one := row.scored.get(column.title))
        }
        draws = len(max(of_rows.values(), key=len, default=()))
        if column.over_draws and draws > 1:
            ranges = [
                (np.ptp([records[0].scores[name] for records in of]), f"{name} of {title}")
                for title, of in of_rows.items()
                for name in MEASURES
            ]
            apart, where = max(ranges)
            alone = "; networks: one draw" * (min(map(len, of_rows.values())) == 1)
            yield f"{column.title}: mean of {draws} draws, at most {hundredths(apart)} apart ({where}){alone}."
    if any(
        view.of_folds(row, column.title) for row in view.printed_rows for column in view.columns
    ):
        yield "Beside means over folds: the least and the greatest fold."
    records = [record for row in view.printed_rows for record in row.records]
    for quantity in MEASURED:
        measured = [record for record in records if quantity.value(record) is not None]
        if quantity.title and measured:
            yield f"{quantity.title}: {quantity.unit}; machine: {_machines(measured)}."


def _machines(records: Iterable[Record]) -> str:
    """Name the machines that made the forms of records."""
    names = [brief(name) for record in records for name in record.machines or ["unknown"]]
    return listed(dict.fromkeys(names), "; ")


def _undecided(view: TableView) -> Iterable[str]:
    """Name the blocks in which no difference is significant and above the scatter, or that have too few classes."""
    printed = {row.method for row in view.printed_rows}
    undecided: dict[str, None] = {}
    for (title, kind), tested in view.tests.items():
        rivals = tested.rivals
        if len(printed & {*rivals}) < 2:
            continue
        if tested.n_classes < FEWEST_CLASSES:
            undecided[f"{title} (not decidable: {tested.n_classes} classes)"] = None
        elif not tested.is_above_scatter.any():
            alone = ": one training each" * bool(
                np.isinf(least_difference([*rivals.values()])[0][0])
            )
            undecided[f"{BLOCKS[kind]} ({title}{alone})"] = None
    return undecided


def _failed(view: TableView, rows: Iterable[Row], crossed: Container[str]) -> list[str]:
    """Name the rows without scores, with the reason, and the column unless it is the only one or they have none."""
    reasons: dict[str, list[str]] = {}
    for row in rows:
        has_any = bool(row.records or row.failed)
        for column in view.columns:
            for record in row.failed.get(column.title, [])[:1]:
                reason = f"{record.status}: {brief(short_reason(record.reason))}"
                break
            else:
                if column.title in row.scored or (
                    row.kind == "network" and column.title in crossed
                ):
                    continue
                reason = (
                    "no model was trained for this data, or it was not run"
                    if row.kind == "network"
                    else "not run"
                )
                reason = "no record yet" if has_any else reason
            where = f"{column.title}: " * (has_any and len(view.columns) > 1)
            reasons.setdefault(where + reason, []).append(row.title)
    return [f"{listed(dict.fromkeys(titles))} ({reason})" for reason, titles in reasons.items()]


def _unreadable(view: TableView, rows: Sequence[Row]) -> Iterable[str]:
    """Name the shapes that no method could use, with the columns and inputs for which that holds."""
    places: dict[str, dict[str, None]] = {}
    for column in view.columns:
        records = [
            record
            for row in rows
            if (one := row.scored.get(column.title))
            for record in one.all_records
        ]
        inputs = {record.input for record in records}
        for record in records:
            where = [column.title] * (len(view.columns) > 1) + [record.input] * (len(inputs) > 1)
            reasons = {name: reason for side in record.sides for name, reason in side.unsupported}
            for name in [name for side in record.sides for name in side.unprepared]:
                places.setdefault(f"{name} ({brief(short_reason(reasons[name]))})", {})[
                    ", ".join(where)
                ] = None
    return [f"{name}{' in ' * any(where)}{' and '.join(where)}" for name, where in places.items()]


def _refused(rows: Iterable[Row]) -> Iterator[str]:
    """Name the shapes that methods refused, with the reason for the first, by column."""
    for row in rows:
        for title, one in row.scored.items():
            sides = [side for record in one.all_records for side in record.sides]
            refused = {
                name: why
                for side in sides
                for name, why in side.unsupported
                if name not in side.unprepared
            }
            for name, why in [*refused.items()][:1]:
                yield f"{row.title} {len(refused)} ({title}; {name}: {brief(short_reason(why))})"


def _seen(rows: Iterable[Row]) -> Iterator[str]:
    for row in rows:
        for title, one in row.scored.items():
            if count := sum(label in one.seen_classes for label in one.labels):
                yield f"{row.title} {count} of {len(one.labels)} shapes ({title})"


def _trained_once(rows: Iterable[Row]) -> Iterator[str]:
    for row in rows:
        galleries = [records for one in row.scored.values() for records in one.records.values()]
        if row.kind == "network" and galleries and max(map(len, galleries)) == 1:
            yield row.title


def _merged(rows: Iterable[Row]) -> Iterator[str]:
    """Name the rows that were merged, with their folders, and digests of their plugins."""
    for row in rows:
        origins = [record.merged_from for record in row.records if record.merged_from]
        folders = dict.fromkeys("/".join(PurePath(of.folder).parts[-2:]) for of in origins)
        plugins = dict.fromkeys(
            f"{PurePath(name).name} {digest}"
            for of in origins
            for name, digest in of.plugins.items()
        )
        if origins:
            by = f": {brief(listed(plugins))}" if plugins else ""
            yield f"{row.title} ({brief(listed(folders))}{by})"


def _moves(view: TableView) -> str:
    """Name the rows whose rank by a second scorer is another one by three or more."""
    if not view.ranks:
        return "no record yet" * view.has_ranks
    moved = []
    for row in view.rows:
        far = [
            f"{name} {a} to {b}"
            for name, (a, b) in view.ranks.get(row.method, {}).items()
            if abs(a - b) >= 3
        ]
        moved += [f"{row.title} ({', '.join(far)})"] * bool(far)
    return (
        f"those of {len(view.ranks)} rows; three or more from those by CM-BOF: {', '.join(moved)}"
    )


def _published(rows: Iterable[Row]) -> str:
    """Name the rows that came with the suite, in a table that also has rows of runs here."""
    scored = [row for row in rows if row.scored]
    published = [row for row in scored if row.is_published]
    if len(published) == len(scored):
        return ""
    commits = sorted({row.records[0].commit[:8] for row in published} - {""})
    return listed(row.title for row in published) + (f" ({', '.join(commits)})" if commits else "")

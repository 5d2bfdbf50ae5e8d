"""Notes below a table, one for each kind of fact."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from itertools import chain, product
from pathlib import PurePath

import numpy as np

from benchmark.errors import short_reason
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROUND, TABLE_MEASURES, Block, GalleryGroup
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.report.columns import QUANTITIES
from benchmark.report.notation import hundredths
from benchmark.report.rivals import ComparedRivals, scatter_of
from benchmark.report.rows import BLOCKS, RowScores, TableRow
from benchmark.report.statistics import FEWEST_CLASSES
from benchmark.report.table_view import TableView
from benchmark.text import brief, counted, listed

#: Most classes of which the notes say that they decide only large differences.
_FEW_CLASSES = 10

#: Ranks by which a row has to move before the notes name it.
_LARGE_MOVE = 3

#: Measure that says which row leads a block.
_LEADING_MEASURE = PAPER_MEASURES[-1]

#: Note on what few classes can decide, and on bold and italic.
FEW = (
    "{} classes decide little: only differences that are large, or alike in nearly all classes, "
    "are found. "
)
QUICK = "A quick run has too few poses: take its marks as a hint, not as a verdict. "
MARKS = (
    "Bold: the best of its block. Italic: not significantly worse (p at least .05; "
    "studentised permutation test over whole classes, of all rows and measures of the block). "
    "In parentheses: significantly worse, but within the scatter of codebooks and, for "
    "networks, of trainings. No mark: worse by more than that. Rows that lack shapes, or with "
    "shapes seen in training, are not tested, and have no mark either."
)
DEPARTURES = "How a method departs from its source: 'python -m benchmark describe METHOD'."


def table_notes(view: TableView) -> list[str]:
    """Return the sentences below a table: on the marks, on its data, and on what it lacks.

    Parameters
    ----------
    view
        The table.
    """
    rows = view.printed_rows
    without_networks = _columns_without_networks(view)
    # What is filled into each sentence; without anything, the sentence is left out.
    facts = {
        "{}": " ".join([view.scored_by.note, *_data_and_columns(view)]).strip(),
        "Networks of views, which have no form of a complete surface: {}.": listed(
            _networks_without(rows, without_networks), "; "
        ),
        "No difference is significant and above the scatter: {}.": listed(_undecided(view)),
        "Too few classes for a test: {}.": listed(_untested(view)),
        "No result: {}.": listed(_without_result(view, rows, without_networks), "; "),
        "Cannot be read or prepared, and count 0: {}.": listed(_unreadable(view, rows), "; "),
        "Refused shapes, which count 0: {}.": listed(_refused(rows), "; "),
        "Trained on the classes of: {}. These shapes stay in the gallery, and decide no claim.": (
            listed(_trained_on_classes(rows), "; ")
        ),
        "Missing, and counts 0: {}.": listed(_missing_galleries(rows)),
        "Left out, because they rank another version of the data: {}; run them again.": listed(
            view.left_out
        ),
        "Not shown, because some rows were scored before tables had it: {}; run them again.": (
            listed(measure for measure in TABLE_MEASURES if measure not in view.measures)
        ),
        "Ranks by spherical harmonics: {}.": _moved_ranks(view),
        "Published with the suite, not run here: {}.": _published(rows),
        "Brought from other folders: {}.": listed(_merged(rows), "; "),
        "Trained with one seed, so no spread over seeds: {}.": listed(_trained_once(rows), "; "),
    }
    notes = [sentence.format(fact) for sentence, fact in facts.items() if fact]
    if view.marks:
        notes.insert(0, _note_on_marks(view))
    return [*notes, DEPARTURES]


def _note_on_marks(view: TableView) -> str:
    """Return what bold and italic mean, and what few classes or poses can decide."""
    reservation = QUICK if view.quick else ""
    numbers = [tested.n_classes for tested in view.tests.values()]
    fewest = min(number for number in numbers if number >= FEWEST_CLASSES)
    if fewest <= _FEW_CLASSES:
        reservation += FEW.format(fewest)
    hidden = listed(_hidden_rivals(view))
    of_hidden = f" These marks count rows that are not printed, too: {hidden}." if hidden else ""
    return reservation + MARKS + of_hidden


def _hidden_rivals(view: TableView) -> list[str]:
    """Name the rows that are tested, and are not printed because only others were selected."""
    printed = {row.method for row in view.printed_rows}
    tested = set[str]()
    for rivals in view.tests.values():
        tested |= rivals.rivals.keys()
    return [row.title for row in view.rows if row.method in tested - printed]


def _columns_without_networks(view: TableView) -> set[str]:
    """Return the columns whose gallery has complete surfaces, in which networks need no scores."""
    columns = set()
    for title, samples in view.samples.items():
        gallery = samples[0].gallery_of_queries
        if gallery is not None and gallery.input == "mesh":
            columns.add(title)
    return columns


def _networks_without(rows: Iterable[TableRow], columns: set[str]) -> list[str]:
    """Name the networks that have no scores in one of some columns."""
    networks = [row for row in rows if row.kind == "network"]
    return [row.title for row in networks if not columns <= row.scored.keys()]


# Which row leads
# ------------------------------------------------------------------------------------------------


def leads(view: TableView) -> list[str]:
    """Return one sentence for each column of a table, on the rows that lead their blocks.

    A block is a group of rows such as the canonical forms. The sentence says how many other rows of
    the block are significantly worse.
    """
    parts_of_columns: dict[str, list[str]] = {}  # of the sentence, by title of the column
    for (title, block), tested in view.tests.items():
        if view.quick:
            parts_of_columns[title] = ["A quick run decides nothing"]
        elif tested.n_classes < FEWEST_CLASSES:
            parts_of_columns[title] = [f"{tested.n_classes} classes decide nothing here"]
        else:
            part = _lead_of_block(view, title, block, tested)
            parts_of_columns.setdefault(title, []).append(part)
    sentences = []
    for title, parts in parts_of_columns.items():
        sentence = f"{'; '.join(parts)}."
        if len(view.columns) > 1:
            sentence = f"{title.capitalize()}. {sentence}"
        sentences.append(sentence)
    return sentences


def _lead_of_block(view: TableView, title: str, block: Block, tested: ComparedRivals) -> str:
    """Say which row leads a block in a column, and how many are significantly worse.

    Parameters
    ----------
    view
        The table.
    title
        Title of the column.
    block
        The rows that are compared, such as ``"form"`` or ``"network"``.
    tested
        The scores of these rows, and which of their differences are significant.
    """
    row, n_worse = block_lead(view, title, block)
    score = hundredths(tested.rivals[row.method].means[_LEADING_MEASURE])
    n_others = len(tested.rivals) - 1
    among = "" if is_tested_whole(view, title, block) else " of the rows that are tested"
    leader = f"{BLOCKS[block]}: {row.title} has the highest {_LEADING_MEASURE}{among}, {score}"
    every = f"the {n_others} others" if n_others > 1 else "the other row"
    if n_worse == 0:
        none = f"any of {every}" if n_others > 1 else every
        return f"{leader}, but not significantly above {none}"
    worse = every if n_worse == n_others else f"{n_worse} of {n_others} others"
    return f"{leader}, significantly and by more than the scatter above {worse}"


def block_lead(view: TableView, title: str, block: Block) -> tuple[TableRow, int]:
    """Return the best row of a block in a column, and how many are significantly worse.

    Those count that are worse by more than the scatter.
    """
    tested = view.tests[title, block]
    methods = [*tested.rivals]
    best = max(methods, key=lambda method: tested.rivals[method].means[_LEADING_MEASURE])
    leading = tested.measures.index(_LEADING_MEASURE)
    n_behind = int(tested.is_above_scatter[methods.index(best), :, leading].sum())
    return next(row for row in view.rows if row.method == best), n_behind


def is_tested_whole(view: TableView, title: str, block: Block) -> bool:
    """Return whether all rows of a block with scores in a column are tested.

    Rows that lack shapes, or saw some in training, are not.
    """
    of_block = {row.method for row in view.rows if row.kind == block and title in row.scored}
    return of_block <= view.tests[title, block].rivals.keys()


def _compared(view: TableView) -> Iterator[tuple[str, Block, ComparedRivals]]:
    """Yield column, block and tests of each block with two or more printed rows in a column."""
    printed = {row.method for row in view.printed_rows}
    for (title, block), tested in view.tests.items():
        if len(printed & tested.rivals.keys()) > 1:
            yield title, block, tested


def _undecided(view: TableView) -> Iterator[str]:
    """Name the blocks of rows, by column, in which no row is clearly better than another.

    A difference is clear if it is significant and larger than the scatter of repeated trainings or
    codebooks. Columns with too few classes for any test are named by :func:`_untested`.
    """
    for title, block, tested in _compared(view):
        if tested.n_classes < FEWEST_CLASSES or tested.is_above_scatter.any():
            continue
        # Of networks that were trained once, the scatter is not known, and counts as infinite.
        scatter = scatter_of([*tested.rivals.values()])
        alone = ": one training each" if np.isinf(scatter.largest[0]) else ""
        yield f"{BLOCKS[block]} ({title}{alone})"


def _untested(view: TableView) -> Iterable[str]:
    """Name the columns with too few classes for any test, with their numbers of classes."""
    untested: dict[str, None] = {}  # an ordered set
    for title, _, tested in _compared(view):
        if tested.n_classes < FEWEST_CLASSES:
            untested[f"{title} ({counted(tested.n_classes, 'class', 'classes')})"] = None
    return untested


# Data and columns
# ------------------------------------------------------------------------------------------------


def _data_and_columns(view: TableView) -> Iterator[str]:
    """Yield sentences on the data of a table, the means in its columns, and its measured times."""
    yield from _remarks_on_table(view)
    for column in view.columns:
        yield from _spread_over_draws(view, column)
    if any(view.of_folds(row, column.title) for row, column in _printed_places(view)):
        yield "Ranges: the lowest and the highest fold."
    records = [*chain.from_iterable(row.records for row in view.printed_rows)]
    for quantity in QUANTITIES:
        measured = [record for record in records if quantity.value(record) is not None]
        if quantity.title and measured:
            yield f"{quantity.title}: {quantity.unit}; machine: {_machines(measured)}."


def _remarks_on_table(view: TableView) -> Iterator[str]:
    """Yield sentences on what a table shows, beyond its caption."""
    if view.table.remark:
        yield view.table.remark
    if any(column.has_mixed_inputs for column in view.columns):
        yield (
            "Methods see complete surfaces, except networks: they see one depth view unless their "
            "title says otherwise."
        )
    if view.table.is_cross:
        keeps_all = view.sample.keeps_same_names
        ranked = "the whole gallery" if keeps_all else "the gallery without its own shape"
        yield (
            f"Each query ranks {ranked}. Queries of a class that the gallery lacks are left out."
        )
    if view.table.names == ROUND:
        yield (
            "Cameras stand around each shape of the gallery, 30 degrees apart. The shape's own "
            "camera is between two of them."
        )
        yield (
            "Of the views of a shape, the nearest to the query counts. In training, the networks "
            "'128 px' and 'extra data' saw views of own cameras alone."
        )
    if view.table.is_ablation:
        yield (
            "The paper's scores of its full network stand beside ours at 128 x 128 pixels, of "
            "which the other rows leave out parts."
        )


def _printed_places(view: TableView) -> Iterator[tuple[TableRow, GalleryGroup]]:
    """Yield each printed row with each column."""
    yield from product(view.printed_rows, view.columns)


def _spread_over_draws(view: TableView, column: GalleryGroup) -> Iterator[str]:
    """Yield how much the scores of a column vary over draws of generated data, and which lack.

    Some data sets are generated several times, with other random bodies, and their column shows
    means. For other columns, nothing is yielded.
    """
    draws = view.table.stand_ins
    n_known = len(view.samples[column.title])
    if column.over_draws and view.dataset in draws and n_known < len(draws):
        yield f"{column.title}: {n_known} of {len(draws)} draws only."
    rows = [(row, row.scored[column.title]) for row in view.rows if column.title in row.scored]
    numbers_of_draws = [len(scores.records) for _, scores in rows]  # of each row
    n_draws = max(numbers_of_draws, default=0)
    if not column.over_draws or n_draws < 2:
        return
    largest_range, where = max(chain.from_iterable(_ranges(row, scores) for row, scores in rows))
    of_networks = [len(scores.records) for row, scores in rows if row.kind == "network"]
    remark = "; networks: one draw" if 1 in of_networks else ""
    yield (
        f"{column.title}: mean of {n_draws} draws, at most {hundredths(largest_range)} apart "
        f"({where}){remark}."
    )


def _ranges(row: TableRow, scores: RowScores) -> Iterator[tuple[float, str]]:
    """Yield the range of the scores of a row over galleries in each measure, and what it is of."""
    firsts = [records[0] for records in scores.records.values()]
    for measure in scores.measures:
        values = [record.scores[measure] for record in firsts]
        yield float(np.ptp(values)), f"{measure} of {row.title}"


def _machines(records: Iterable[Record]) -> str:
    """Name the machines that made the forms of records."""
    names = chain.from_iterable(record.machines or ["unknown"] for record in records)
    return listed(dict.fromkeys(map(brief, names)), "; ")


# What has no scores
# ------------------------------------------------------------------------------------------------


def _without_result(
    view: TableView, rows: Iterable[TableRow], without_networks: Container[str]
) -> list[str]:
    """Name the rows without scores, with the reason.

    The column is named unless it is the only one, or the row has scores in none. Where a row has
    scores of some galleries of a column, such as folds, the gallery is named.
    """
    shown = [column.title for column in view.columns]
    reasons = defaultdict[str, list[str]](list)
    for row in rows:
        # The table leaves out a column in which all rows failed.
        titles = dict.fromkeys([*shown, *row.failed])
        for title in titles:
            reason = _why_no_scores(row, title, without_networks)
            if not reason:
                continue
            has_any = bool(row.records or row.failed)
            where = f"{title}: " if has_any and len(titles) > 1 else ""
            if title in row.scored:
                where = f"{row.failed[title][0].gallery}: "
            reasons[where + reason].append(row.title)
    return [
        f"{listed(dict.fromkeys(titles), '; ')} ({reason})" for reason, titles in reasons.items()
    ]


def _why_no_scores(row: TableRow, column: str, without_networks: Container[str]) -> str:
    """Return why a cell of a table is empty.

    Parameters
    ----------
    row
        Row of the table.
    column
        Title of the column.
    without_networks
        Columns in which networks are not meant to have scores.

    Returns
    -------
    str
        The reason; "" if the row has scores, or is not meant to have any.
    """
    # A record of a failure says more than all that follows.
    if column in row.failed:
        failed = row.failed[column][0]
        return f"{failed.status}: {brief(short_reason(failed.reason))}"
    if column in row.scored or (row.kind == "network" and column in without_networks):
        return ""
    if row.records or row.failed:  # in other columns
        return "not run, or the method does not take this input"
    if row.kind == "network":
        return (
            "no model was trained for this data, or it was not run; 'run --train' trains the "
            "models that this code can train"
        )
    return "not run"


def _missing_galleries(rows: Iterable[TableRow]) -> Iterator[str]:
    """Name the rows that lack galleries, such as folds, with these."""
    for row in rows:
        for scores in row.scored.values():
            if scores.missing:
                yield f"{row.title} ({', '.join(scores.missing)})"


def _unreadable(view: TableView, rows: Sequence[TableRow]) -> Iterator[str]:
    """Name the shapes that no method could use, because their files cannot be read or prepared.

    If the table has several columns or inputs, those in which this is so follow the name, such as
    ``cat3 in TOSCA, view``.

    Parameters
    ----------
    view
        The table.
    rows
        The rows that are printed.
    """
    places_of_shapes = defaultdict[str, dict[str, None]](dict)  # an ordered set for each shape
    for column in view.columns:
        scores = [row.scored[column.title] for row in rows if column.title in row.scored]
        records = list(chain.from_iterable(of_row.all_records for of_row in scores))
        has_both_inputs = len({record.input for record in records}) > 1
        for record in records:
            place = []
            if len(view.columns) > 1:
                place.append(column.title)
            if has_both_inputs:
                place.append(record.input)
            for shape in _unprepared_shapes(record):
                places_of_shapes[shape][", ".join(place)] = None
    for shape, places in places_of_shapes.items():
        if any(places):
            yield f"{shape} in {' and '.join(places)}"
        else:
            yield shape


def _unprepared_shapes(record: Record) -> Iterator[str]:
    """Name the shapes of a record that could not be prepared for any method, with the reason."""
    reasons = dict(chain.from_iterable(side.unsupported for side in record.sides))
    for shape in chain.from_iterable(side.unprepared for side in record.sides):
        yield f"{shape} ({brief(short_reason(reasons[shape]))})"


def _refused(rows: Iterable[TableRow]) -> Iterator[str]:
    """Name the rows whose methods refused shapes, with the reason for the first shape."""
    for row in rows:
        for title, scores in row.scored.items():
            reasons = _refusals(scores)
            if reasons:
                (_, shape), reason = next(iter(reasons.items()))
                why = brief(short_reason(reason))
                yield f"{row.title} {len(reasons)} ({title}; {shape}: {why})"


def _refusals(scores: RowScores) -> dict[tuple[str, str], str]:
    """Return the shapes that a method refused though they could be prepared, with the reasons.

    A shape is known by its gallery and its name, as bodies of several draws share their names.
    """
    reasons: dict[tuple[str, str], str] = {}
    for side in chain.from_iterable(record.sides for record in scores.all_records):
        for shape, why in side.unsupported:
            if shape not in side.unprepared:
                reasons[side.gallery, shape] = why
    return reasons


# Trainings and origins
# ------------------------------------------------------------------------------------------------


def _trained_on_classes(rows: Iterable[TableRow]) -> Iterator[str]:
    """Name the networks that were trained on classes which they rank, with the number of shapes."""
    for row in rows:
        for title, scores in row.scored.items():
            n_seen = sum(label in scores.seen_classes for label in scores.labels)
            if n_seen:
                yield f"{row.title} ({title}: {n_seen} of {len(scores.labels)} shapes)"


def _trained_once(rows: Iterable[TableRow]) -> Iterator[str]:
    """Name the networks that have one training in each gallery."""
    for row in rows:
        galleries = [
            *chain.from_iterable(scores.records.values() for scores in row.scored.values())
        ]
        n_trainings = max((len(records) for records in galleries), default=0)
        if row.kind == "network" and n_trainings == 1:
            yield row.title


def _merged(rows: Iterable[TableRow]) -> Iterator[str]:
    """Name the rows whose records were merged from other results folders.

    In parentheses follow the last two parts of the path of each folder, and the plugins that made
    the records, each with the digest of its file.
    """
    for row in rows:
        folders: dict[str, None] = {}  # ordered sets
        plugins: dict[str, None] = {}
        for record in row.records:
            origin = record.merged_from
            if not origin:
                continue
            folders["/".join(PurePath(origin.folder).parts[-2:])] = None
            for path, digest in origin.plugins.items():
                plugins[f"{PurePath(path).name} {digest}"] = None
        if not folders:
            continue
        origins = brief(listed(folders))
        if plugins:
            origins += f": {brief(listed(plugins))}"
        yield f"{row.title} ({origins})"


def _published(rows: Iterable[TableRow]) -> str:
    """Name the rows that came with the suite, in a table that also has rows of runs here."""
    scored = [row for row in rows if row.scored]
    published = [row for row in scored if row.is_published]
    if len(published) == len(scored):
        return ""
    titles = listed(row.title for row in published)
    commits = sorted({row.records[0].commit[:8] for row in published} - {""})
    if not commits:
        return titles
    return f"{titles} ({', '.join(commits)})"


def _moved_ranks(view: TableView) -> str:
    """Name the rows whose rank by a second scorer differs by three places or more.

    "" for a table that shows no ranks by a second scorer.
    """
    if not view.has_ranks:
        return ""
    if not view.ranks:
        return "no record yet"
    moved = []
    for row in view.printed_rows:
        far = [
            f"{measure} {ranks.by_default} to {ranks.by_second}"
            for measure, ranks in view.ranks.get(row.method, {}).items()
            if abs(ranks.by_default - ranks.by_second) >= _LARGE_MOVE
        ]
        if far:
            moved.append(f"{row.title} ({', '.join(far)})")
    names = ", ".join(moved) or "none"
    return f"those of {len(view.ranks)} rows. Three or more away from the ranks by CM-BOF: {names}"

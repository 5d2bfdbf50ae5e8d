"""Tables of finished jobs, chosen by what they show."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.commands.printable_tables import Tables
from benchmark.commands.selection import RESULTS, RecordSelection, as_texts
from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.records import Record


def tables(
    names: str | Iterable[str] = (),
    *,
    results: str | Path = RESULTS,
    data: str | Path | Iterable[str | Path] = (),
    methods: str | Iterable[str] = (),
    input: Input | None = None,
    scorer: str = DEFAULT_SCORER,
    seed: int = 0,
    quick: bool = False,
    published: bool = False,
    paper: bool = False,
    failed: bool = False,
    submissions: str | Path | None = None,
) -> Tables:
    """Return the tables of finished jobs; it needs no data.

    Parameters
    ----------
    names
        Identifiers of tables, such as ``"III"``; all by default.
    results
        The results folder.
    data, methods, input, scorer, seed, quick, published
        Which records to show; see :class:`benchmark.commands.selection.RecordSelection`.
    paper
        Whether to add rows of the paper that never ran.
    failed
        Whether to add methods that fail in every job.
    submissions
        Folder of submissions whose rows are added; see
        :func:`benchmark.commands.submissions.submitted_rows`.

    Raises
    ------
    ConfigurationError
        If nothing fits the selection, or a name is unknown.
    """
    submitted: tuple[Record, ...] = ()
    notes_on_submissions: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    if submissions is not None:
        # This imports all that runs methods, which other tables do without.
        from benchmark.commands.submissions import submitted_rows

        rows = submitted_rows(submissions, results)
        submitted = rows.records
        notes_on_submissions = rows.notes
        refused = rows.refused
    selection = RecordSelection(
        results=Path(results),
        tables=as_texts(names),
        methods=as_texts(methods),
        data=as_texts(data),
        input=input,
        scorer=scorer,
        seed=seed,
        quick=quick,
        published=published,
        submitted=submitted,
    )
    records, notes = selection.records(failed=failed)
    views = selection.printed_views(records, notes, paper=paper)
    return Tables(
        tuple(views),
        tuple(records),
        (*notes, *selection.empty_tables(records, views), *notes_on_submissions),
        refused,
        of_robustness=tuple(selection.of_robustness(records)),
        is_whole=selection.is_whole,
    )

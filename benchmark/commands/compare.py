"""Differences of a method to another one, or to every row of its tables."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.api.contracts import Input
from benchmark.commands.selection import RESULTS, RecordSelection, as_texts
from benchmark.defaults import DEFAULT_SCORER
from benchmark.report.comparison import compare_rows

if TYPE_CHECKING:
    from pandas import DataFrame


def compare(
    first: str,
    second: str = "",
    *,
    results: str | Path = RESULTS,
    tables: str | Iterable[str] = (),
    data: str | Path | Iterable[str | Path] = (),
    input: Input | None = None,
    scorer: str = DEFAULT_SCORER,
    seed: int = 0,
    quick: bool = False,
    published: bool = False,
) -> DataFrame:
    """Test the differences of a method to another one, or to every row of its tables.

    Parameters
    ----------
    first, second
        Names of the methods; "" compares with all others.
    results
        The results folder.
    tables, data, input, scorer, seed, quick, published
        Which records to compare; see :class:`benchmark.commands.selection.RecordSelection`.

    Returns
    -------
    pandas.DataFrame
        One line for each measure and pair of methods: scores, their difference with an interval,
        p-values and verdicts; see :func:`benchmark.report.comparison.compare_rows`.
        ``attrs["notes"]`` says which records were left out.

    Raises
    ------
    ConfigurationError
        If a row has no scores, or no table has scores of both.
    """
    selection = RecordSelection(
        results=Path(results),
        tables=as_texts(tables),
        methods=[*filter(None, (first, second))],
        data=as_texts(data),
        input=input,
        scorer=scorer,
        seed=seed,
        quick=quick,
        published=published,
    )
    # Failed jobs stay, so that a method without scores is named in the error.
    records, notes = selection.records(failed=True)
    views = selection.views(records)
    frame = compare_rows(views, first, second)
    frame.attrs["notes"] = [*notes, *selection.empty_tables(records, views)]
    return frame

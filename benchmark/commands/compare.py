"""Differences of a method to another one, or to every row of its tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.api.contracts import Input
from benchmark.commands.selection import RESULTS
from benchmark.commands.tables import tables as tables_of
from benchmark.defaults import DEFAULT_SCORER
from benchmark.report.comparison import compare_rows

if TYPE_CHECKING:
    from pandas import DataFrame


def compare(
    first: str,
    second: str = "",
    *,
    results: str | Path = RESULTS,
    tables: str | Sequence[str] = (),
    data: str | Path | Sequence[str | Path] = (),
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
    found = tables_of(
        tables,
        results=results,
        data=data,
        methods=[first, second],
        input=input,
        scorer=scorer,
        seed=seed,
        quick=quick,
        published=published,
        failed=True,  # so that a method without scores is named in the error
    )
    frame = compare_rows(found.views, first, second)
    frame.attrs["notes"] = list(found.notes)
    return frame

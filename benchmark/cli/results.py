"""``tables``, ``report`` and ``compare``: print and write what finished jobs show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from benchmark.cli.options import OF_RECORDS, Selection
from benchmark.cli.printing import print_markdown
from benchmark.commands.printable_tables import Tables
from benchmark.commands.tables import tables
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines, say_table

if TYPE_CHECKING:
    from pandas import DataFrame


def print_tables(
    selection: Selection,
    format: str | None,
    *,
    paper: bool,
    failed: bool,
    submissions: Path | None = None,
) -> bool:
    """Print tables in a format, Markdown by default; return whether all submissions have a row."""
    selected = _tables_with_notes(selection, paper=paper, failed=failed, submissions=submissions)
    if format is None:
        print_markdown(selected.markdown())
    elif format == "latex":
        say_lines(selected.latex())
    else:
        say_lines("\n".join(selected.texts(format)))
    return not selected.refused


def write_tables(
    selection: Selection,
    output: Path,
    format: str | None,
    *,
    paper: bool,
    failed: bool,
    force: bool,
    submissions: Path | None = None,
) -> bool:
    """Write tables as files in a format, or in all; return whether all submissions have a row."""
    from benchmark.report.output import TABLE_FORMATS

    selected = _tables_with_notes(selection, paper=paper, failed=failed, submissions=submissions)
    formats = [format] if format else TABLE_FORMATS
    files = selected.write(output, formats, force=force)
    say(f"wrote {len(files)} files to {output}")
    return not selected.refused


def write_report_pages(selection: Selection, output: Path, *, failed: bool, force: bool) -> None:
    """Write the pages of a report."""
    from benchmark.commands.report import write_pages
    from benchmark.kernel_cache.announcing import announce_compilation

    announce_compilation()
    selected = _tables_with_notes(selection, paper=selection.published, failed=failed)
    files = write_pages(
        selected, output, results=selection.results, data_root=selection.data_root, force=force
    )
    say(f"wrote {output / 'index.html'} and {len(files) - 1} other files")


def draw_figure(
    selection: Selection,
    path: Path,
    kind: Literal["forms", "map"],
    shapes: Sequence[str],
    *,
    force: bool,
) -> None:
    """Draw a figure of the first of the selected tables, and write it as a picture.

    Parameters
    ----------
    selection
        Which records to show.
    path
        The picture; its extension says the format.
    kind
        ``"forms"`` for poses and their forms, or ``"map"`` for shapes as points.
    shapes
        Names of the shapes of a figure of forms.
    force
        Whether to replace a file.

    Raises
    ------
    ConfigurationError
        If the file is there, or nothing fits the selection.
    """
    from benchmark.commands.report import draw_tables
    from benchmark.report.drawing import check_ending

    check_ending(path)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} is there already", "choose another file, or pass --force")
    selected = _tables_with_notes(selection, paper=False, failed=False)
    draw_tables(
        selected,
        path,
        kind,
        shapes,
        results=selection.results,
        data_root=selection.data_root,
    )
    say(f"wrote {path}")


def print_comparison(selection: Selection, first: str, second: str, format: str) -> None:
    """Print how a method differs from another one, or from all others in its tables.

    Parameters
    ----------
    selection
        Which records to compare.
    first
        Name of the method.
    second
        Name of the other method; "" for all others.
    format
        ``"csv"``, ``"json"``, or text for people.
    """
    from benchmark.commands.compare import compare

    of_records = selection.arguments(name for name in OF_RECORDS if name != "methods")
    differences = compare(first, second, **of_records)
    _say_notes(differences.attrs["notes"])
    if format == "csv":
        say_lines(differences.to_csv(index=False, float_format="%.6f"))
    elif format == "json":
        say_lines(differences.to_json(orient="records", indent=1, double_precision=6))
    else:
        if second:
            _print_details(differences, first, second)
        else:
            _print_summaries(differences, first)


def _print_details(differences: DataFrame, first: str, second: str) -> None:
    """Print all differences between the scores of two methods.

    Parameters
    ----------
    differences
        One line for each measure and column of a table.
    first, second
        Names of the methods.
    """
    from benchmark.report.comparison import LEGEND, details

    say(f"A: {first}")
    say(f"B: {second}")
    say("A - B above 0: A scores higher.")
    for heading, grids in details(differences):  # by column of a table
        say()
        say(heading)
        for rows in grids:
            say_table(rows, whole=range(4))
    has_tests = differences.p.notna().any()
    if has_tests:
        say()
        for line in LEGEND:
            say(line)


def _print_summaries(differences: DataFrame, first: str) -> None:
    """Print the differences of a row to many others, a line each."""
    from benchmark.report.comparison import summaries

    for heading, rows in summaries(differences):
        say(heading)
        say_table(rows, whole=range(1, 6))
    say(f"Above 0: {first} scores higher.")


def _tables_with_notes(
    selection: Selection, *, paper: bool, failed: bool, submissions: Path | None = None
) -> Tables:
    """Return the tables of a selection; say what was left out."""
    of_records = selection.arguments(name for name in OF_RECORDS if name != "tables")
    selected = tables(
        selection.tables, **of_records, paper=paper, failed=failed, submissions=submissions
    )
    _say_notes(selected.notes)
    return selected


def _say_notes(notes: Iterable[str]) -> None:
    """Print notes beside the output."""
    for note in notes:
        say(note, err=True)

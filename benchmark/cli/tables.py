"""``tables`` and ``compare``: print results and differences."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.pipeline.records import Record, read_records
from benchmark.protocols.tables import TABLES
from benchmark.report.comparison import compare as compare_records
from benchmark.report.formats import as_json, latex, markdown, text
from benchmark.report.frames import chosen_records
from benchmark.report.output import FORMATS, scores_csv, table_files, write_files
from benchmark.report.robustness import robustness_markdown
from benchmark.report.tables import TableView, table_views
from benchmark.text import say, say_lines


def recorded(options: Selection) -> list[Record]:
    """Return the records of a selection of data, input, scorer and seed.

    Raises
    ------
    ConfigurationError
        If there is none, or no record knows a table or data set.
    """
    every = read_records(options.results, local=not options.published)
    known = {table.identifier for table in TABLES} | {record.data.name for record in every} | {"extended"}
    for name in options.tables:
        if name not in known:
            raise did_you_mean("table", name, known)
    names = {*options.datasets, *map(os.path.realpath, options.datasets)}
    records = [
        record
        for record in chosen_records(every, quick=options.quick, scorer=options.scorer, seed=options.seed)
        if (not names or {record.data.name, record.data.source, os.path.realpath(record.data.source)} & names)
        and options.input in (None, record.input)
    ]
    if not records:
        hint = "run it first, select less, or drop --quick" if options.quick else "run it first, or select less"
        raise ConfigurationError(f"no finished job under {options.results} fits the selection", hint)
    return records


def selected_tables(options: Selection, records: Iterable[Record]) -> list[TableView]:
    """Return the tables of a selection; raise ``ConfigurationError`` if there is none."""
    rows = options.methods if options.is_narrow else ()
    sets = {record.data.name for record in records} if options.datasets else ()
    views = table_views(records, options.tables, rows, sets)
    if not views and "robustness" not in options.tables:
        what = f"table {', '.join(options.tables)}" if options.tables else "any table"
        problem = f"no finished job under {options.results} belongs to {what}"
        raise ConfigurationError(problem, "run it first, or select less")
    return views


def tables(options: Selection, format: str | None, output: Path | None, *, force: bool) -> None:
    """Print or write tables."""
    records = recorded(options)
    views = selected_tables(options, records)
    is_whole = not (options.tables or options.methods or options.datasets or options.input or options.quick)
    if output is not None:
        files = table_files(views, records, [format] if format else FORMATS, is_whole=is_whole)
        write_files(output, files, force=force)
        say(f"wrote {len(files)} files to {output}")
    elif format == "json":
        say_lines(json.dumps(as_json(views), indent=1))
    elif format == "csv":
        say_lines(scores_csv(records))
    elif format == "latex":
        say_lines("\n".join(map(latex, views)))
    elif format == "markdown" or not sys.stdout.isatty():
        pivot = [robustness_markdown(records)] if is_whole or "robustness" in options.tables else []
        say_lines("\n".join([*map(markdown, views), *pivot]))
    else:
        print_tables(views)


def print_tables(views: Iterable[TableView]) -> None:
    """Print tables, in bold and italics where that goes to a terminal."""
    width = shutil.get_terminal_size().columns
    for view in views:
        print(f"\n{text(view, width, colour=sys.stdout.isatty())}", end="")  # noqa: T201  # it has escape sequences


def compare(options: Selection, first: str, second: str) -> None:
    """Print the differences of two methods."""
    for line in compare_records(recorded(options), first, second):
        say(line)

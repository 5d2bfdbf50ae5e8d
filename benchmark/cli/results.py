"""Records of a selection, and the tables and figures that they make."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError, check_known
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.records import SUITE_RESULTS, Record, read_records
from benchmark.protocols.tables import TABLES, TITLES
from benchmark.report.columns import MEASURED, PRINTED_SCORES
from benchmark.report.formats import markdown
from benchmark.report.frames import chosen_records, row_of
from benchmark.report.tables import TableView, table_views
from benchmark.text import brief, counted, say, say_lines


def recorded(options: Selection, *, failed: bool = False) -> list[Record]:
    """Return the records of a selection of data, input, scorer and seed.

    With ``failed``, also those of methods that have scores on no data at all, are not selected, and
    not the paper's.

    Raises
    ------
    ConfigurationError
        If there is none, or no record knows a table or data set.
    """
    has_published = options.results != Selection().results or (options.results / "records").is_dir()
    folder = options.results if has_published or not options.published else SUITE_RESULTS
    every = label_data_sets(read_records(folder, local=not options.published))
    known = (
        {table.identifier for table in TABLES}
        | {record.data.name for record in every}
        | {"extended"}
    )
    check_known("table", options.tables, known)
    of_data = options.records_of_data(every)
    of_input = [record for record in of_data if options.input in (None, record.input)]
    full, quick = (
        chosen_records(of_input, quick=is_quick, scorer=options.scorer, seed=options.seed)
        for is_quick in (False, True)
    )
    records = quick if options.quick else full or quick
    others = [
        of for of in of_input if of.scorer not in (options.scorer, "") or of.seed != options.seed
    ]
    if others:
        ways = ", or ".join(
            sorted({f"--scorer {of.scorer or options.scorer} --seed {of.seed}" for of in others})
        )
        say(
            f"not shown: {counted(len(others), 'job')} of another scorer or seed: pass {ways}",
            err=True,
        )
    newest = max((record.finished for record in full if not record.published), default="")
    newer = [record for record in quick if record.finished > newest]
    if newer and not options.quick:
        says = (
            f"{len(newer)} newer quick jobs are not shown: pass --quick"
            if full
            else "these are quick runs"
        )
        say(f"{says} ({', '.join(dict.fromkeys(record.data.name for record in newer))})", err=True)
    if not records:
        what = "published record" if options.published else "finished job"
        first = "pass --results CHECKOUT/results" if options.published else "run it first"
        problem = f"no {what} under {options.results} fits the selection"
        raise ConfigurationError(problem, f"{first}, or select less")
    known = {row_of(record) for record in every if failed or record.status == "ok"} | {*TITLES}
    named = {
        record.method
        for record in every
        if {record.method, record.method.partition("[")[0]} & {*options.methods}
    }
    shown = [
        record for record in records if row_of(record) in known or record.method in named
    ] or records
    hidden = {record.method: outcome(record) for record in records if record not in shown}
    for method, reason in hidden.items():
        say(f"left out, as it fails in every job: {method}: {reason}; --failed shows it", err=True)
    return shown


def selected_tables(
    options: Selection, records: Iterable[Record], *, paper: bool = False
) -> list[TableView]:
    """Return the tables of a selection; raise ``ConfigurationError`` if there is none.

    With ``paper``, rows of the paper that never ran are among them.
    """
    rows = options.methods if options.is_narrow else ()
    sets = {record.data.name for record in records} if options.datasets else ()
    views = table_views(records, options.tables, rows, sets, paper=paper)
    if not views and "robustness" not in options.tables:
        what = f"table {', '.join(options.tables)}" if options.tables else "any table"
        problem = f"no finished job under {options.results} belongs to {what}"
        raise ConfigurationError(problem, "run it first, or select less")
    return views


def print_tables(views: Iterable[TableView], robustness: str = "") -> None:
    """Print tables, and that of robustness, as Markdown, which a terminal shows with its marks."""
    shown = "\n".join(filter(None, [*map(markdown, views), robustness]))
    if not sys.stdout.isatty():
        say_lines(shown)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(shown))


def outcome(record: Record) -> str:
    """Return scores and seconds of a record, or why it has none, on one line."""
    if record.status != "ok":
        return brief(record.reason)
    scores = " ".join(f"{column.title} {column.cell(record)}" for column in PRINTED_SCORES)
    refused = f"; {brief(record.refusals)}" if record.unsupported else ""
    measured = ", ".join(
        f"{column.cell(record)} {column.title} a shape" for column in MEASURED if column.title
    )
    return f"{scores}  ({measured}{refused})"


def draw(options: Selection, path: Path, what: str, shapes: Sequence[str], *, force: bool) -> None:
    """Draw a figure."""
    from benchmark.report import figures  # matplotlib takes half a second
    from benchmark.report.drawing import check_ending
    from benchmark.report.forms import StoredForms

    check_ending(path)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} is there already", "choose another file, or pass --force")
    views = selected_tables(options, recorded(options))
    if not views:
        raise ConfigurationError(
            "the table of robustness has no figures", "select another one with -t"
        )
    view, forms = views[0], StoredForms(options.results, options.data_root)
    figure = (
        figures.map_figure(view, forms)
        if what == "map"
        else figures.forms_figure(view, forms, shapes)
    )
    figures.save(figure, path)
    say(f"wrote {path}")

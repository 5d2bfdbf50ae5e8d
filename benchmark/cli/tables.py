"""``tables`` and ``compare``: print results and differences."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.cli.options import Selection, name_skipped
from benchmark.cli.selection import is_of_data, no_table, recorded, stored, tables_of
from benchmark.cli.terminal import print_tables
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.merging import records_under
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, variant
from benchmark.plugins.scorers import scorer_of, scorers
from benchmark.report.comparison import compare_methods, lines
from benchmark.report.formats import overview, render
from benchmark.report.output import Folder
from benchmark.report.robustness import file_stem, rendered, robustness
from benchmark.text import say, say_lines

if TYPE_CHECKING:
    from pandas import DataFrame

#: Number of tables that are printed in full if methods are named; otherwise each row has one line.
_FEW = 2

FORMATS = ("latex", "markdown", "csv", "json")

#: Patterns of the files that single tables are written to.
_WRITTEN = re.compile(r"(table|paper-table|robustness)-.*\.(md|tex|png)")


def tables(options: Selection, format: str | None, output: Path | None, *, check: bool, force: bool) -> bool:
    """Print or write tables, or compare them with existing files."""
    formats: tuple[str, ...] = (format,) if format else ()
    if check and output is None:
        raise ConfigurationError("--check has nothing to compare with", "name the folder of the tables with -o DIR")
    store = stored(options, output)
    if store.published_only and not options.published and Store(store.root).records.has_files:
        say(f"{output} holds published tables, so your own records are omitted; choose another -o for them", err=True)
    results = recorded(options, store)
    content = tables_of(options, results)
    perturbed = robustness(results) if "robustness" in options.tables or not options.tables else []
    if not content and not perturbed:
        raise no_table(options)
    if output is None:
        if not formats and options.is_narrow and len(content) > _FEW:
            say_lines(overview(content))
            say(f"{len(content)} tables: select with -t and -d to see each with its notes")
            return True
        if formats == ("latex",) and options.tables:  # to paste: without the tables that go with them
            content = [table for table in content if table.identifier in options.tables]
        texts: dict[str, str] = {}
        if not formats and sys.stdout.isatty():
            print_tables(content)
        else:
            texts = render(content, formats or ("markdown",), has_variants=False)
        whole_files = ("csv", "json") if content else ()  # other programs read a single document
        texts |= rendered(perturbed, [name for name in formats or ("markdown",) if name not in whole_files])
        for text in texts.values():
            say_lines(text)
        return True
    is_whole = not (formats or options.tables or options.methods or options.datasets or options.input)
    formats = formats or FORMATS
    texts = render(content, formats) | rendered(perturbed, formats)
    files, folder = {name: text.encode() for name, text in texts.items()}, Folder(output, "tables", force=force)
    drawn = perturbed if "markdown" in formats else []
    if check:
        return _check(folder, files, drawn, is_whole=is_whole)
    folder.write(files)
    if drawn:
        from benchmark.report.pictures.charts import draw_curves

        draw_curves(drawn, output)
    say(f"wrote {', '.join(files)} to {output}")
    return True


def _check(folder: Folder, files: dict[str, bytes], drawn: list[DataFrame], *, is_whole: bool) -> bool:
    """Compare tables with the files in a folder, which must contain no others if all tables are compared."""
    pictures = {f"{file_stem(frame)}.png" for frame in drawn}
    stale = [*folder.stale(files), *sorted(name for name in pictures if not (folder.root / name).is_file())]
    others = {path.name for path in folder.root.glob("*")} - files.keys() - pictures
    left_over = sorted(name for name in others if is_whole and _WRITTEN.fullmatch(name))
    if stale:
        say(f"stale: {', '.join(stale)}")
    if left_over:
        say(f"left over: {', '.join(left_over)}; remove these files, which belong to no table any more")
    if stale or left_over:
        return False
    say(f"{len(files) + len(pictures)} files are up to date")
    return True


def compare(options: Selection, first: str, second: str, *, everything: bool) -> None:
    """Print the differences of two methods."""
    known_scorers = scorers(options.plugins)
    store = Store(options.results / "runs", published_only=options.published)
    try:
        records = [record for record in records_under(store) if is_of_data(record, options)]
    finally:
        name_skipped(store)
    known, recorded_methods = methods(options.plugins), {record["method"] for record in records}
    one, other = (name if name in recorded_methods else variant(name, known).name for name in (first, second))
    comparison = compare_methods(records, one, other, scorer_of(options.scorer, known_scorers).name)
    if not comparison.differences:
        raise ConfigurationError(f"no gallery has scores of both {first} and {second}", "run both on one data set")
    for line in lines(comparison, first, second, everything=everything):
        say(line)

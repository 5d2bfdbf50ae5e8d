"""``tables`` and ``report``: what finished jobs say."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli.options import (
    NOT_OK,
    OK,
    SELECTION,
    PathOption,
    RunOptions,
    add_options,
    timeout_option,
)
from benchmark.cli.reporting import FIGURES, no_table
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines

if TYPE_CHECKING:
    from benchmark.report.latex import Notes

#: Tables that are printed whole where methods are named; of more, each row has a line.
_FEW = 2

FORMATS = ("latex", "markdown", "csv", "json")

#: Names of files that this verb writes for single tables.
_WRITTEN = re.compile(r"(table|paper-table|intervals-table|splits-table|robustness)-.*\.(md|tex|png)")


@click.command()
@add_options(*SELECTION)
@click.option("--format", "formats", multiple=True, type=click.Choice(FORMATS), help="[markdown; with -o, all]")
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="DIR",
    help="Write files instead of printing.",
)
@click.option("--check", is_flag=True, help="Compare with the files in -o DIR; exit 1 if they differ.")
@click.option(
    "--notes",
    type=click.Choice(["table", "appendix", "none"]),
    default="table",
    show_default=True,
    help="LaTeX notes: below each table, in files notes-TABLE.tex, or none.",
)
@click.option("--rows-only", is_flag=True, help="LaTeX: the rows of each table, without float, heading and notes.")
@click.option("--bibliography", is_flag=True, help="Print BibTeX entries after LaTeX; with -o, they are a file.")
@click.option("--all", "everything", is_flag=True, help="Print whole tables for many methods, too.")
@add_options("force", "published")
@click.option("--fresh", is_flag=True, help="Omit rows made by other code or versions.")
def tables(
    formats: tuple[str, ...],
    output: Path | None,
    check: bool,
    notes: Notes,
    rows_only: bool,
    bibliography: bool,
    everything: bool,
    force: bool,
    fresh: bool,
    **options: Any,
) -> None:
    """Print tables of finished jobs, or write them to files; needs no data."""
    from benchmark.pipeline.storage.store import Store
    from benchmark.report.content import contents
    from benchmark.report.files import render
    from benchmark.report.formats import overview
    from benchmark.report.output import Folder
    from benchmark.report.robustness import file_stem, rendered, robustness

    if check and output is None:
        raise ConfigurationError("--check has nothing to compare with", "name the folder of the tables with -o DIR")
    selection = RunOptions.of(options)
    store = selection.store(output)
    if store.published_only and not selection.published and Store(store.root).records.has_files:
        say(f"{output} holds published tables, so your own records are omitted; choose another -o for them", err=True)
    recorded = selection.recorded(store, fresh=fresh)
    content = contents(recorded, selection.tables, blanks=not selection.is_narrow, named=selection.is_by_name)
    perturbed = robustness(recorded) if "robustness" in selection.tables or not selection.tables else []
    if not content and not perturbed:
        raise no_table(selection)
    is_screen = output is None and not formats
    if is_screen and selection.is_narrow and len(content) > _FEW and not everything:
        say_lines(overview(content))
        say(f"{len(content)} tables: select with -t and -d, or print them with notes, intervals and tests by --all")
        return
    if is_screen and sys.stdout.isatty():
        from benchmark.cli.terminal import draw

        draw(content)
        for text in rendered(perturbed, ("markdown",)).values():
            say_lines(text)
        return
    if output is None:
        chosen = formats or ("markdown",)
        texts = render(
            content, chosen, notes, has_variants=False, rows_only=rows_only, has_sources=bibliography
        ) | rendered(perturbed, chosen)
        for text in texts.values():
            say_lines(text)
        return
    texts = render(content, formats or FORMATS, notes, rows_only=rows_only) | rendered(perturbed, formats or FORMATS)
    files, folder = {name: text.encode() for name, text in texts.items()}, Folder(output, "tables", force=force)
    if not check:
        folder.write(files)
        if perturbed and "markdown" in (formats or FORMATS):
            from benchmark.report.pictures.charts import draw_curves

            draw_curves(perturbed, output)
        say(f"wrote {', '.join(files)} to {output}")
        return
    pictures = {f"{file_stem(each)}.png" for each in perturbed if "markdown" in (formats or FORMATS)}
    different = [*folder.stale(files), *sorted(name for name in pictures if not (output / name).is_file())]
    is_whole = not (selection.tables or selection.methods or selection.datasets or selection.inputs or formats)
    others = {path.name for path in output.glob("*")} - files.keys() - pictures
    left_over = sorted(name for name in others if is_whole and _WRITTEN.fullmatch(name))
    if different:
        say(f"stale: {', '.join(different)}")
    if left_over:
        say(f"left over: {', '.join(left_over)}; remove what no table is written to any more")
    if not (different or left_over):
        say(f"{len(files) + len(pictures)} files are up to date")
    sys.exit(NOT_OK if different or left_over else OK)


@click.command()
@add_options(*SELECTION)
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    default=Path("results/report"),
    show_default=True,
    metavar="DIR",
)
@add_options("force", "published")
@click.option(
    "--figure", type=PathOption(), metavar="FILE", help="Draw a figure (.pdf, .png or .svg) instead; see --of."
)
@click.option(
    "--of",
    "what",
    type=click.Choice(FIGURES),
    default=FIGURES[0],
    show_default=True,
    help="One subject by all methods; subjects before and after one method; accuracy against cost; precision over "
    "recall; nearest matches by class; scores by class.",
)
@click.option("--subject", "subjects", multiple=True, metavar="NAME", help="Subject to show in a figure.")
@click.option("--shape", "shapes", multiple=True, metavar="NAME", help="Shape to show in a figure.")
@timeout_option("missing forms of a method")
def report(
    output: Path,
    force: bool,
    figure: Path | None,
    what: str,
    subjects: tuple[str, ...],
    shapes: tuple[str, ...],
    timeout: float,
    **options: Any,
) -> None:
    """Write HTML pages: tables, charts, canonical forms in 3D, and every query with its nearest shapes.

    They work without a network. Nothing is computed; where data is missing, a page names the run that creates it.
    """
    from benchmark.cli.reporting import write_figure, write_pages

    selection = RunOptions.of(options)
    if figure is not None:
        write_figure(selection, figure, what, subjects, shapes, timeout, force=force)
    else:
        write_pages(selection, output, force=force)

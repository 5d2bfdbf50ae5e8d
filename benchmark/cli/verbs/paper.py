"""``paper``: a folder that one command compiles to a PDF of results."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli.options import SELECTION, PathOption, RunOptions, add_options
from benchmark.cli.reporting import name_edited, no_table
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.report.paper.document import Template


@click.command()
@add_options(*SELECTION)
@click.option(
    "-o", "--output", type=PathOption(), default=Path("results/paper"), show_default=True, metavar="DIR",
)  # fmt: skip
@click.option(
    "--template",
    type=click.Choice(["article", "ieee"]),
    default="article",
    show_default=True,
    help="LaTeX class.",
)
@add_options("force", "published")
def paper(output: Path, template: Template, force: bool, **options: Any) -> None:
    """Write a LaTeX paper of results: protocol, tables, figures, statistics, sources; compile it by 'make' in DIR.

    Without -t and -d it contains Tables I to IV and those of your own data. Files that you edited are kept.
    """
    from benchmark.plugins.registry import methods
    from benchmark.report.artefact_reader import ArtefactReader
    from benchmark.report.content import contents
    from benchmark.report.output import Folder
    from benchmark.report.paper.document import main_tables, paper_files

    selection = RunOptions.of(options)
    store = selection.store()
    recorded = selection.recorded(store)
    tables = contents(recorded, selection.tables, blanks=not selection.is_narrow, named=selection.is_by_name)
    tables = [table for table in tables if any(cell.scores for row in table.rows for cell in row.cells.values())]
    if not tables:
        raise no_table(selection)
    if not (selection.tables or selection.datasets):
        tables = main_tables(tables)
    artefacts = ArtefactReader(store, methods(selection.plugins), selection.data_root)
    files = paper_files(tables, artefacts, template)
    name_edited(output, Folder(output, "paper", "written-by-paper.json", force).write(files))
    say(f"wrote {len(files)} files to {output}; compile them: make -C {shlex.quote(str(output))}")
    if "figures/forms.pdf" not in files:
        figure = shlex.quote(str(output / "figures" / "forms.pdf"))
        say(f"no forms are stored here; draw some with report -d DATASET --figure {figure}")

"""The verbs of ``data``: list the data sets, check one, draw one, write one out."""

from __future__ import annotations

import sys
from collections.abc import Collection
from pathlib import Path

import click

from benchmark.cli.options import NameOrFolder, PathOption, data_root_option
from benchmark.system.text import clean, say

#: What ``list`` shows of a data set on a terminal of 80 columns; the rest stands in its JSON.
COLUMNS = ("name", "state", "shapes", "classes", "source")


def print_rows(rows: list[dict[str, str]], as_json: bool, columns: Collection[str] = ()) -> None:
    """Print what a list verb found, as JSON or in columns, with a heading where only some of them are shown."""
    if as_json:
        import json

        click.echo(json.dumps(rows, indent=1))
        return
    if columns:
        rows = [{key: key for key in columns}, *({key: row[key] for key in columns} for row in rows)]
    lines = [[clean(value) for value in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = (cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        say("  ".join(cells).rstrip())


@click.group()
def data() -> None:
    """List data sets, check one, draw one, or write one out in an official layout."""


@data.command("list")
@click.option("--json", "as_json", is_flag=True, help="For other programs.")
@data_root_option
def list_(as_json: bool, data_root: Path | None) -> None:
    """List the data sets: official or generated, present or absent."""
    from benchmark.cli import listing

    print_rows(listing.datasets(data_root), as_json, COLUMNS)


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER")
@data_root_option
def check(name: str, data_root: Path | None) -> None:
    """Look for anything wrong in a data set; exit 1 if it cannot be used as it is."""
    from benchmark.cli.counting import counting
    from benchmark.datasets.checking import check_source

    with counting(f"checking {name}") as watched:
        report = check_source(name, data_root, watched)
    for line in report.lines():
        say(line)
    sys.exit(0 if report.usable else 1)


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER")
@click.option(
    "-o",
    "--output",
    required=True,
    type=PathOption(),
    metavar="DIR",
    help="Folder to write; must be empty or new.",
)
@click.option(
    "--layout",
    required=True,
    type=click.Choice(["shrec14", "tosca"]),
    help="shrec14: 0.obj, 1.obj ... and a .cla file; tosca: CLASS + number .off.",
)
@click.option("--force", is_flag=True, help="Write into a folder that is not empty, replacing files of the same name.")
@data_root_option
def export(name: str, output: Path, layout: str, force: bool, data_root: Path | None) -> None:
    """Write a data set as files that '-d DIR' reads with the same shapes, classes and cameras."""
    from benchmark.cli.counting import counting
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.datasets.export import export as write

    with counting(f"writing {name}") as watched:
        files = write(open_dataset(name, data_root), output, layout, force=force, watched=watched)
    say(f"wrote {len(files)} files to {output}; use them with -d {output}")


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER")
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="FILE.png",
    help="File to write; by default sheet-NAME.png.",
)
@click.option("--subjects", type=click.IntRange(min=1), metavar="K", help="Rows; all subjects by default.")
@click.option("--poses", type=click.IntRange(min=1), default=8, show_default=True, metavar="K", help="Columns.")
@data_root_option
def sheet(name: str, output: Path | None, subjects: int | None, poses: int, data_root: Path | None) -> None:
    """Draw a data set at a glance: subjects in some poses, as surface and as depth image."""
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.report.pictures.contact_sheet import contact_sheet

    dataset = open_dataset(name, data_root)
    drawn = contact_sheet(dataset, subjects, poses)
    for problem in drawn.problems:
        say(f"not drawn: {problem}", err=True)
    target = output or Path(f"sheet-{dataset.name}.png")
    drawn.save(target)
    say(f"wrote {target}")

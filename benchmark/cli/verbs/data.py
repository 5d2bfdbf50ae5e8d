"""The verbs of ``data``: list the data sets, check one, draw one, write one out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli import completion
from benchmark.cli.options import NameOrFolder, PathOption, add_options, told_what_it_is
from benchmark.errors import ConfigurationError
from benchmark.text import clean, say

if TYPE_CHECKING:
    from benchmark.datasets.base import Dataset

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
    """List, check, draw or export data sets."""


@data.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@add_options("plugins", "data_root")
def list_(as_json: bool, plugins: tuple[Path, ...], data_root: Path | None) -> None:
    """List the data sets: official or generated, present or absent."""
    from benchmark.cli import listing

    print_rows(listing.datasets(data_root, plugins), as_json, COLUMNS)


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER", shell_complete=completion.datasets)
@add_options("plugins", "data_root")
def check(name: str, plugins: tuple[Path, ...], data_root: Path | None) -> None:
    """Check a data set; exit 1 if it cannot be used."""
    lines, is_usable = _on_data(_checked, name, plugins, data_root, name)
    for line in lines:
        say(line)
    sys.exit(0 if is_usable else 1)


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER", shell_complete=completion.datasets)
@click.option(
    "-o",
    "--output",
    required=True,
    type=PathOption(),
    metavar="DIR",
    help="New or empty folder.",
)
@click.option(
    "--layout",
    type=click.Choice(["shrec14", "tosca", "frames"]),
    help="shrec14: 0.obj, 1.obj ... and a .cla file; tosca: CLASS + number .off; frames: depth images, of camera sets.",
)
@click.option("--force", is_flag=True, help="Write into a non-empty folder, replacing files of the same name.")
@add_options("plugins", "data_root")
def export(
    name: str, output: Path, layout: str | None, force: bool, plugins: tuple[Path, ...], data_root: Path | None
) -> None:
    """Write a data set as files that '-d DIR' reads with the same shapes, classes and cameras."""
    from benchmark.datasets.catalogue import FRAME_SETS

    layout = layout or ("frames" if name in FRAME_SETS else None)
    if layout is None:
        raise ConfigurationError("no layout is chosen", "pass --layout shrec14 or --layout tosca")
    count = _on_data(_exported, name, plugins, data_root, name, str(output), layout, force)
    say(f"wrote {count} files to {output}; use them with -d {output}")


@data.command()
@click.argument("name", type=NameOrFolder(), metavar="NAME|FOLDER", shell_complete=completion.datasets)
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="FILE.png",
    help="File to write. [sheet-NAME.png]",
)
@click.option("--subjects", type=click.IntRange(min=1), metavar="K", help="Rows. [all subjects]")
@click.option("--poses", type=click.IntRange(min=1), default=8, show_default=True, metavar="K", help="Columns.")
@click.option(
    "--perturbations",
    "--nuisances",
    "perturbations",
    metavar="SHAPE",
    help="Draw only this shape, under each perturbation.",
)
@add_options("plugins", "data_root")
def sheet(
    name: str,
    output: Path | None,
    subjects: int | None,
    poses: int,
    perturbations: str | None,
    plugins: tuple[Path, ...],
    data_root: Path | None,
) -> None:
    """Draw a data set at a glance: subjects in some poses, as surface and as depth image."""
    problems, target = _on_data(
        _drawn, name, plugins, data_root, str(output) if output else "", subjects, poses, perturbations
    )
    for problem in problems:
        say(f"not drawn: {problem}", err=True)
    say(f"wrote {target}")


def _on_data(
    work: Callable[..., Any], name: str, plugins: Iterable[Path], data_root: Path | None, *arguments: Any
) -> Any:
    """Do something to a data set: here, or in a process of its own where it comes from a plugin file."""
    from benchmark.datasets.catalogue import sources
    from benchmark.datasets.own import is_own
    from benchmark.execution.processes.calls import Guard, call_apart

    with told_what_it_is(name, "data set"):
        (source,) = sources([name], plugins)
    root = str(data_root) if data_root else None
    if not is_own(source):
        return work(source, root, *arguments)
    guard = Guard(f"data set '{name}'", "correct the file: 'check' says more")
    return call_apart(work, source, root, *arguments, guard=guard)


def _checked(source: str, root: str | None, name: str) -> tuple[list[str], bool]:
    """Return what is told of a data set, and whether it can be used."""
    from benchmark.cli.counting import counting
    from benchmark.datasets.checking import check_source

    with counting(f"checking {name}") as watched:
        report = check_source(source, Path(root) if root else None, watched)
    return list(report.lines()), report.usable


def _exported(source: str, root: str | None, name: str, output: str, layout: str, force: bool) -> int:
    """Number of files that were written."""
    from benchmark.cli.counting import counting
    from benchmark.datasets.camera_frames import CameraFrames
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.datasets.export import export as write
    from benchmark.datasets.export import export_frames

    with counting(f"writing {name}") as watched:
        dataset = open_dataset(source, Path(root) if root else None)
        if layout == "frames":
            if not isinstance(dataset, CameraFrames):
                raise ConfigurationError(f"data set '{name}' has no frames", "choose another --layout")
            return len(export_frames(dataset, Path(output), force=force, watched=watched))
        return len(write(dataset, Path(output), layout, force=force, watched=watched))


def _drawn(
    source: str, root: str | None, output: str, subjects: int | None, poses: int, perturbations: str | None
) -> tuple[list[str], str]:
    """Return what could not be drawn, and the file that was written."""
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.datasets.perturbations.overview import overview
    from benchmark.report.pictures.painting import save_png
    from benchmark.report.pictures.sheets import contact_sheet

    dataset: Dataset = open_dataset(source, Path(root) if root else None)
    if perturbations is not None:
        dataset = overview(dataset, perturbations)
    drawn = contact_sheet(dataset, subjects, poses)
    target = Path(output or f"sheet-{dataset.name}.png")
    save_png(drawn.image, target)
    return list(map(str, drawn.problems)), str(target)

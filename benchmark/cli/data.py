"""``data``: list the data sets, check one, draw one, write one out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import click

from benchmark.cli.declare import NAME_OR_FOLDER, PATH, argument, complete_datasets, flag, option
from benchmark.cli.methods import print_datasets
from benchmark.cli.options import explained, shared, verb
from benchmark.cli.terminal import counting
from benchmark.datasets.camera_frames import CameraFrames
from benchmark.datasets.catalogue import FRAME_SETS, open_dataset, sources
from benchmark.datasets.checking import check_source
from benchmark.datasets.export import export as export_shapes
from benchmark.datasets.export import export_frames
from benchmark.datasets.own import is_own
from benchmark.datasets.perturbations.overview import overview
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.text import say

_NAME = argument("NAME|FOLDER", type=NAME_OR_FOLDER, shell_complete=complete_datasets)


@verb
def list_(
    as_json: bool = flag("--json", help="Print JSON."),
    plugins: tuple[Path, ...] = shared("plugins"),
    data_root: Path | None = shared("data_root"),
) -> None:
    """List the data sets: official or generated, present or absent."""
    print_datasets(plugins, data_root, as_json=as_json)


@verb
def check(
    name: str = _NAME, plugins: tuple[Path, ...] = shared("plugins"), data_root: Path | None = shared("data_root")
) -> bool:
    """Check a data set; exit 1 if it cannot be used."""
    lines, is_usable = _on_data(_checked, name, plugins, data_root, name)
    for line in lines:
        say(line)
    return bool(is_usable)


@verb
def export(
    name: str = _NAME,
    output: Path = option("-o", "--output", required=True, type=PATH, metavar="DIR", help="New or empty folder."),
    layout: str | None = option(
        "--layout", type=click.Choice(["shrec14", "tosca", "frames"]),
        help="shrec14: 0.obj, 1.obj ... and a .cla file; tosca: CLASS + number .off; frames: depth images, of camera"
        " sets.",
    ),
    force: bool = flag("--force", help="Write into a non-empty folder, replacing files of the same name."),
    plugins: tuple[Path, ...] = shared("plugins"),
    data_root: Path | None = shared("data_root"),
) -> None:  # fmt: skip
    """Write a data set as files that '-d DIR' reads with the same shapes, classes and cameras."""
    layout = layout or ("frames" if name in FRAME_SETS else None)
    if layout is None:
        raise ConfigurationError("no layout is chosen", "pass --layout shrec14 or --layout tosca")
    count = _on_data(_exported, name, plugins, data_root, name, output, layout, force)
    say(f"wrote {count} files to {output}; use them with -d {output}")


@verb
def sheet(
    name: str = _NAME,
    output: Path | None = option(
        "-o", "--output", type=PATH, metavar="FILE.png", help="File to write. [sheet-NAME.png]"
    ),
    subjects: int | None = option("--subjects", type=click.IntRange(min=1), metavar="K", help="Rows. [all subjects]"),
    poses: int = option("--poses", type=click.IntRange(min=1), default=8, metavar="K", help="Columns."),
    perturbations: str | None = option(
        "--perturbations", "--nuisances", metavar="SHAPE", help="Draw only this shape, under each perturbation."
    ),
    plugins: tuple[Path, ...] = shared("plugins"),
    data_root: Path | None = shared("data_root"),
) -> None:
    """Draw a data set at a glance: subjects in some poses, as surface and as depth image."""
    problems, target = _on_data(_drawn, name, plugins, data_root, output, subjects, poses, perturbations)
    for problem in problems:
        say(f"not drawn: {problem}", err=True)
    say(f"wrote {target}")


data = click.Group("data", help="List, check, draw or export data sets.", commands=[list_, check, export, sheet])


def _on_data(
    work: Callable[..., Any], name: str, plugins: Iterable[Path], data_root: Path | None, *arguments: Any
) -> Any:
    """Do something to a data set: here, or in a process of its own where it comes from a plugin file."""
    with explained(name, "data set"):
        (source,) = sources([name], plugins)
    if not is_own(source):
        return work(source, data_root, *arguments)
    guard = Guard(f"data set '{name}'", "correct the file: 'check' says more")
    return call_apart(work, source, data_root, *arguments, guard=guard)


def _checked(source: str, data_root: Path | None, name: str) -> tuple[list[str], bool]:
    """Return the findings on a data set, and whether it can be used."""
    report = check_source(source, data_root, partial(counting, f"checking {name}"))
    return list(report.lines()), report.usable


def _exported(source: str, data_root: Path | None, name: str, output: Path, layout: str, force: bool) -> int:
    """Number of files that were written."""
    dataset, watched = open_dataset(source, data_root), partial(counting, f"writing {name}")
    if layout != "frames":
        return len(export_shapes(dataset, output, layout, force=force, watched=watched))
    if not isinstance(dataset, CameraFrames):
        raise ConfigurationError(f"data set '{name}' has no frames", "choose another --layout")
    return len(export_frames(dataset, output, force=force, watched=watched))


def _drawn(
    source: str, data_root: Path | None, output: Path | None, subjects: int | None, poses: int, shape: str | None
) -> tuple[list[str], str]:
    """Return what could not be drawn, and the file that was written."""
    from benchmark.report.pictures.painting import save_png
    from benchmark.report.pictures.sheets import contact_sheet

    dataset = open_dataset(source, data_root)
    if shape is not None:
        dataset = overview(dataset, shape)
    drawing = contact_sheet(dataset, subjects, poses)
    target = output or Path(f"sheet-{dataset.name}.png")
    save_png(drawing.image, target)
    return list(map(str, drawing.problems)), str(target)

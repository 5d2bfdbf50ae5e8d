"""``data``: check, draw and export data sets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmark.cli.options import CheckData, DataOptions, Export, Sheet, explained
from benchmark.cli.terminal import counting
from benchmark.datasets.catalogue import open_dataset, sources
from benchmark.datasets.checking import check_source
from benchmark.datasets.export import export as export_shapes
from benchmark.datasets.own import is_own
from benchmark.datasets.perturbations.overview import overview
from benchmark.execution.processes.calls import call_apart
from benchmark.text import say


def check(options: CheckData) -> bool:
    """Print the content of a data set and its problems."""
    lines, is_usable = _on_data(_checked, options)
    for line in lines:
        say(line)
    return bool(is_usable)


def export(options: Export) -> None:
    """Write the files of a data set."""
    count = _on_data(_exported, options)
    say(f"wrote {count} files to {options.output}; use them with -d {options.output}")


def sheet(options: Sheet) -> None:
    """Draw a contact sheet."""
    problems, target = _on_data(_drawn, options)
    for problem in problems:
        say(f"not drawn: {problem}", err=True)
    say(f"wrote {target}")


def _on_data(work: Callable[..., Any], options: DataOptions, *arguments: Any) -> Any:
    """Apply a function to a data set; in a child process if the set comes from a plugin file."""
    with explained(options.name, "data set"):
        (source,) = sources([options.name], options.plugins)
    if not is_own(source):
        return work(source, options, *arguments)
    what, hint = f"data set '{options.name}'", "correct the file: 'check' says more"
    return call_apart(work, source, options, *arguments, what=what, hint=hint)


def _checked(source: str, options: CheckData) -> tuple[list[str], bool]:
    """Return the lines of a report on a data set, and whether the set can be used."""
    report = check_source(source, options.data_root, partial(counting, f"checking {options.name}"))
    return list(report.lines()), report.usable


def _exported(source: str, options: Export) -> int:
    """Export a data set; return the number of files."""
    dataset, watched = open_dataset(source, options.data_root), partial(counting, f"writing {options.name}")
    return len(export_shapes(dataset, options.output, force=options.force, watched=watched))


def _drawn(source: str, options: Sheet) -> tuple[list[str], str]:
    """Draw a data set; return the shapes that could not be drawn, and the file."""
    from benchmark.report.pictures.painting import save_png
    from benchmark.report.pictures.sheets import contact_sheet

    dataset = open_dataset(source, options.data_root)
    if options.perturbations is not None:
        dataset = overview(dataset, options.perturbations)
    drawing = contact_sheet(dataset, options.subjects, options.poses)
    target = options.output or Path(f"sheet-{dataset.name}.png")
    save_png(drawing.image, target)
    return list(map(str, drawing.problems)), str(target)

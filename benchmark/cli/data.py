"""``data``: check, draw and export data sets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmark.cli.options import Selection, explained
from benchmark.cli.terminal import counting
from benchmark.datasets.catalogue import open_dataset, sources
from benchmark.datasets.checking import check_source
from benchmark.datasets.export import export as export_shapes
from benchmark.datasets.own import is_own
from benchmark.execution.processes.calls import call_apart
from benchmark.text import say


def check(name: str, options: Selection) -> bool:
    """Print the content of a data set and its problems."""
    lines, is_usable = _on_data(_checked, name, options)
    for line in lines:
        say(line)
    return bool(is_usable)


def export(name: str, options: Selection, output: Path, *, force: bool) -> None:
    """Write the files of a data set."""
    count = _on_data(_exported, name, options, output, force)
    say(f"wrote {count} files to {output}; use them with -d {output}")


def sheet(name: str, options: Selection, output: Path | None, subjects: int | None, poses: int) -> None:
    """Draw a contact sheet."""
    problems, target = _on_data(_drawn, name, options, output, subjects, poses)
    for problem in problems:
        say(f"not drawn: {problem}", err=True)
    say(f"wrote {target}")


def _on_data(work: Callable[..., Any], name: str, options: Selection, *arguments: Any) -> Any:
    """Apply a function to a data set; in a child process if the set comes from a plugin file."""
    root = options.require_data_root()
    with explained(name, "data set"):
        (source,) = sources([name], options.plugins)
    if not is_own(source):
        return work(source, name, root, *arguments)
    what, hint = f"data set '{name}'", "correct the file: 'check' says more"
    return call_apart(work, source, name, root, *arguments, what=what, hint=hint)


def _checked(source: str, name: str, root: Path | None) -> tuple[list[str], bool]:
    """Return the lines of a report on a data set, and whether the set can be used."""
    report = check_source(source, root, partial(counting, f"checking {name}"))
    return list(report.lines()), report.usable


def _exported(source: str, name: str, root: Path | None, output: Path, force: bool) -> int:
    """Export a data set; return the number of files."""
    return len(
        export_shapes(open_dataset(source, root), output, force=force, watched=partial(counting, f"writing {name}"))
    )


def _drawn(
    source: str, name: str, root: Path | None, output: Path | None, subjects: int | None, poses: int
) -> tuple[list[str], str]:
    """Draw a data set; return the shapes that could not be drawn, and the file."""
    from benchmark.report.pictures.painting import save_png
    from benchmark.report.pictures.sheets import contact_sheet

    dataset = open_dataset(source, root)
    drawing = contact_sheet(dataset, subjects, poses)
    target = output or Path(f"sheet-{dataset.name}.png")
    save_png(drawing.image, target)
    return list(map(str, drawing.problems)), str(target)

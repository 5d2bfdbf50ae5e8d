"""``data``: check, draw and export data sets."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.progress import counting
from benchmark.datasets.catalogue import open_dataset, sources
from benchmark.datasets.checking import check_source
from benchmark.datasets.export import export as export_shapes
from benchmark.report.drawing import check_ending, save_png
from benchmark.report.sheets import contact_sheet
from benchmark.text import say


def check(name: str, options: Selection) -> bool:
    """Print the content of a data set and its problems; return whether it can be used."""
    report = check_source(_source(name, options), options.data_root, partial(counting, f"checking {name}"))
    for line in report.lines():
        say(line)
    return report.usable


def export(name: str, options: Selection, output: Path, *, force: bool) -> bool:
    """Write the files of a data set; return whether all shapes could be read."""
    dataset = open_dataset(_source(name, options), options.data_root)
    written, problems = export_shapes(dataset, output, force=force, watched=partial(counting, f"writing {name}"))
    for problem in problems:
        say(f"not written: {problem}", err=True)
    say(f"wrote {len(written)} files to {output}; use them with -d {output}")
    return not problems


def sheet(name: str, options: Selection, output: Path | None) -> None:
    """Draw a contact sheet."""
    dataset = open_dataset(_source(name, options), options.data_root)
    target = output or Path(f"sheet-{dataset.name}.png")
    check_ending(target)
    image, problems = contact_sheet(dataset)
    for problem in problems:
        say(f"not drawn: {problem}", err=True)
    save_png(image, target)
    say(f"wrote {target}")


def _source(name: str, options: Selection) -> str:
    options.require_data_root()
    (source,) = sources([name], options.plugins)
    return source

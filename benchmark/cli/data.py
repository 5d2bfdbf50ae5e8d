"""``data check``, ``data export`` and ``models fetch``: data sets and models as files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmark.cli.progress import counting
from benchmark.commands.selection import data_folder, shadowed_folders
from benchmark.datasets.catalogue import is_known
from benchmark.text import say


def print_check_of_data(name: str, data_root: Path | None) -> bool:
    """Check a data set; return whether it can be used."""
    from benchmark.datasets.checking import check_source

    root = _root_with_notes(name, data_root)
    report = check_source(name, root, partial(counting, f"checking {name}"))
    for line in report.lines():
        say(line)
    return report.usable


def write_data(name: str, data_root: Path | None, output: Path, *, views: bool) -> bool:
    """Write a data set as files; return whether all shapes, and views, could be written."""
    from benchmark.commands.export import export

    root = _root_with_notes(name, data_root)
    watched = partial(counting, f"writing {name}")
    written, problems = export(name, output, views=views, data_root=root, watched=watched)
    for problem in problems:
        say(f"not written: {problem}", err=True)
    # A name of the suite would mean its set, and not this folder.
    folder = f"./{output}" if is_known(str(output)) else str(output)
    say(f"wrote {len(written)} files to {output}; use them with {shlex.join(['-d', folder])}")
    return not problems


def _root_with_notes(name: str, data_root: Path | None) -> Path | None:
    """Return the folder of the official data sets; say if a folder here has the name of a set."""
    root = data_folder(data_root)
    for note in shadowed_folders([name], root):
        say(note, err=True)
    return root


def print_fetched_models(source: str, names: Sequence[str]) -> bool:
    """Bring published models; return whether all could be had."""
    from benchmark.commands.models import fetch_models, in_words

    watched = partial(counting, f"fetching models from {source}")
    fetched = fetch_models(source, names, watched=watched)
    for model, problem in fetched.problems.items():
        say(f"{model}: {problem}", err=True)
    say(in_words(fetched))
    return not fetched.problems

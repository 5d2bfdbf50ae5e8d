"""``demo``: write a page to play with, and open it."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.progress import counting
from benchmark.commands.demo import demo
from benchmark.kernel_cache.announcing import announce_compilation
from benchmark.text import say


def write_demo(
    meshes: Sequence[Path], output: Path, selection: Selection, *, is_opened: bool = True
) -> bool:
    """Write the page of a demo, and open it in a browser where there is a screen.

    Parameters
    ----------
    meshes
        Mesh files; without any, a generated cat is shown.
    output
        The page.
    selection
        Methods, plugins and seed.
    is_opened
        Whether to open it.

    Returns
    -------
    bool
        Whether each method made a form of each mesh; other methods and meshes are on the page.
    """
    announce_compilation()
    page = demo(
        meshes,
        output,
        methods=selection.methods,
        plugins=selection.plugins,
        seed=selection.seed,
        watched=lambda forms: counting("computing forms", forms, name=str),
    )
    for problem in page.problems:
        say(problem, err=True)
    say(f"wrote {page.path}: open it in a browser, and drag the slider")
    if is_opened and has_screen():
        webbrowser.open(page.path.absolute().as_uri())
    return not page.problems


def has_screen() -> bool:
    """Return whether a browser can show a page, as it cannot in a container or a remote shell."""
    if sys.platform == "darwin":
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))

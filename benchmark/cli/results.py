"""``report``: pages and figures of a selection."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError
from benchmark.text import say


def draw(options: Selection, path: Path, what: str, shapes: Sequence[str], *, force: bool) -> None:
    """Draw a figure."""
    from benchmark.report import figures, grids  # matplotlib takes half a second
    from benchmark.report.drawing import check_ending
    from benchmark.report.forms import StoredForms

    check_ending(path)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} is there already", "choose another file, or pass --force")
    from benchmark.commands.tables import tables

    shown = tables(**options.of_tables())
    for note in shown.notes:
        say(note, err=True)
    if not shown.views:
        raise ConfigurationError(
            "the table of robustness has no figures", "select another one with -t"
        )
    view, forms = shown.views[0], StoredForms(options.results, options.data_root)
    figure = (
        figures.map_figure(view, forms)
        if what == "map"
        else figures.forms_figure(view, forms, shapes)
    )
    grids.save(figure, path)
    say(f"wrote {path}")

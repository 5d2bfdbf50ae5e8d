"""``report``: write HTML pages and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.tables import recorded, selected_tables
from benchmark.errors import ConfigurationError
from benchmark.report import figures
from benchmark.report.drawing import check_ending
from benchmark.report.forms import StoredForms
from benchmark.report.pages import write_report
from benchmark.report.results import Results
from benchmark.text import say


def draw(options: Selection, path: Path, what: str, shapes: Sequence[str], *, force: bool) -> None:
    """Draw a figure."""
    check_ending(path, figures.ENDINGS)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} is there already", "choose another file, or pass --force")
    if what == "scorers":
        from pandas import read_csv

        figure = figures.scorers_figure(read_csv(path.with_suffix(".csv")))
    else:
        views = selected_tables(options, recorded(options))
        if not views:
            raise ConfigurationError("the table of robustness has no figures", "select another one with -t")
        view = views[0]
        forms = StoredForms(options.results, options.data_root)
        if what == "effect":
            figure = figures.effect_figure(view, forms, shapes)
        elif what == "precision-recall":
            figure = figures.precision_recall_figure(view, forms)
        else:
            figure = (figures.cost_figure if what == "cost" else figures.scores_figure)(view)
    figures.save(figure, path)
    say(f"wrote {path}")


def write_pages(options: Selection, output: Path, *, force: bool) -> None:
    """Write the pages."""
    records = recorded(options)
    views = selected_tables(options, records)
    results = Results(options.results, tuple(records))
    files = write_report(results, views, output, data_root=options.data_root, force=force)
    say(f"wrote {output / 'index.html'} and {len(files) - 1} other files")

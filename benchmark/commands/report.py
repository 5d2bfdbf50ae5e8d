"""The report on finished jobs as HTML pages, and figures of its tables."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.commands.printable_tables import Tables
from benchmark.commands.selection import as_texts
from benchmark.commands.tables import tables
from benchmark.defaults import DEFAULT_SCORER, RESULTS
from benchmark.errors import ConfigurationError
from benchmark.report.forms import StoredForms

#: Folder of a report where none is named.
REPORT_FOLDER = Path("results/report")

_OTHER_TABLE = "select another one with -t, or print it with 'tables -t robustness'"


def write_report(
    folder: str | Path = REPORT_FOLDER,
    names: str | Iterable[str] = (),
    *,
    results: str | Path = RESULTS,
    data: str | Path | Iterable[str | Path] = (),
    methods: str | Iterable[str] = (),
    input: Input | None = None,
    scorer: str = DEFAULT_SCORER,
    seed: int = 0,
    quick: bool = False,
    published: bool = False,
    failed: bool = False,
    data_root: str | Path | None = None,
    force: bool = False,
) -> list[str]:
    """Write the report on finished jobs as HTML pages, and return the names of its files.

    Parameters
    ----------
    folder
        The folder of the pages, created if necessary.
    names
        Identifiers of tables, such as ``"III"``; all by default.
    results
        The results folder.
    data, methods, input, scorer, seed, quick, published, failed
        Which records to show; see :func:`benchmark.tables`.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.
    force
        Whether to replace files that were edited or come from elsewhere.

    Raises
    ------
    ConfigurationError
        If nothing fits the selection, or a file would be replaced that was edited or that no
        command has written.
    """
    selected = tables(
        names,
        results=results,
        data=data,
        methods=methods,
        input=input,
        scorer=scorer,
        seed=seed,
        quick=quick,
        published=published,
        paper=published,
        failed=failed,
    )
    return write_pages(selected, folder, results=results, data_root=data_root, force=force)


def write_pages(
    selected: Tables,
    folder: str | Path,
    *,
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
    force: bool = False,
) -> list[str]:
    """Write the pages of some tables, and return their names; see :func:`write_report`."""
    from benchmark.report.output import check_folder, write_files
    from benchmark.report.pages import report_files

    check_folder(Path(folder))  # before pages are drawn, which takes long
    if not selected.views:
        raise ConfigurationError("the table of robustness has no pages", _OTHER_TABLE)
    root = Path(data_root) if data_root else None
    files = report_files(Path(results), selected.views, root)
    write_files(Path(folder), files, force=force)
    return list(files)


def draw_tables(
    selected: Tables,
    path: Path,
    kind: Literal["forms", "map"],
    shapes: str | Iterable[str] = (),
    *,
    results: Path = RESULTS,
    data_root: Path | None = None,
) -> None:
    """Draw a figure of a table, and write it as a picture.

    Parameters
    ----------
    selected
        Tables, of which the first is drawn.
    path
        The picture; its extension says the format.
    kind
        ``"forms"`` for poses and their forms, or ``"map"`` for shapes as points.
    shapes
        Names of the shapes of a figure of forms; by default three poses of the first class.
    results
        The results folder with the stored forms.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.

    Raises
    ------
    ConfigurationError
        If there is no table with figures, or no form or distances are stored.
    """
    from benchmark.report.figures import forms_figure, map_figure
    from benchmark.report.grids import write_figure

    if not selected.views:
        raise ConfigurationError("the table of robustness has no figures", _OTHER_TABLE)
    view = selected.views[0]
    forms = StoredForms(results, data_root)
    if kind == "map":
        write_figure(map_figure(view, forms), path)
    else:
        write_figure(forms_figure(view, forms, as_texts(shapes)), path)

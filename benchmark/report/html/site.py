"""The whole report: pages, and the data that they load when it is wanted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.records import Record
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.html.gallery import Gallery, make_gallery
from benchmark.report.html.measured import measured
from benchmark.report.html.pages import Board, TablePages, forms_page, index_page, queries_page, set_stem, table_page
from benchmark.report.html.queries import write_queries
from benchmark.report.html.scripts import Files, Progress, add_script
from benchmark.report.html.thumbnails import MOST_SMALL_FORMS, Sheets, write_thumbnails
from benchmark.report.output import Folder

#: Forms in the whole report, at 13 kilobytes each: with plotly and the queries it stays below thirty megabytes.
MOST_FORMS = 1200

#: Shapes of a data set whose forms are shown at most.
MOST_SHAPES = 24

#: Lists what a report consists of, so that the next one removes what it does not write again, and nothing else.
CONTENTS = "parts/contents.json"

_ASSETS = ("report.css", "report.js", "charts.js", "forms.js", "queries.js")


@dataclass(frozen=True)
class Written:
    """Files of a report.

    Parameters
    ----------
    edited
        Names of files that were left as somebody has edited them.
    n_files, size
        Files and bytes.
    n_forms
        Canonical forms that can be turned.
    n_distances, n_ranked
        Jobs whose distances were here, of those with scores.
    """

    edited: list[str]
    n_files: int
    size: int
    n_forms: int
    n_distances: int
    n_ranked: int


def write_report(
    tables: Sequence[TableContent],
    artefacts: ArtefactReader,
    root: Path,
    command: str,
    say: Progress = lambda _: None,
    boards: Sequence[Board] = (),
    *,
    force: bool = False,
) -> Written:
    """Write the report into its folder.

    Parameters
    ----------
    tables
        The tables to show.
    artefacts
        Where distances, surfaces and forms are, as far as they are here; without them the report shows the records.
    root
        Where it goes.
    command
        The command line that made it.
    say
        Told what is being done.
    boards
        Rows of bundles.
    force
        Whether files are replaced that no report has written, or that were edited.

    Raises
    ------
    BenchmarkError
        If a file cannot be written or would take the place of what is of no report, or plotly is not installed.
    """
    names = [f"{table.file_stem}{ending}.html" for table in tables for ending in ("", "-forms", "-queries")]
    folder = Folder(root, "report", CONTENTS, force)
    folder.require_own(["index.html", *names])
    files = _assets()
    sets = _by_set(tables)
    per_set = _shapes_per_set(sets)
    small = max(1, MOST_SMALL_FORMS // max(_columns(sets), 1))
    galleries: dict[str, Gallery | None] = {}
    pictures: dict[str, dict[Input, Sheets]] = {}
    for stem, records in sets.items():
        say(f"drawing {records[0]['data']['name']}")
        galleries[stem] = make_gallery(stem, records, artefacts, files, most_shapes=per_set)
        pictures[stem] = write_thumbnails(stem, records, artefacts, files, small, say)
    made: list[TablePages] = []
    for table in tables:
        say(f"ranking {table.data['name']}")
        made.append(TablePages(table, measured(table, artefacts), galleries.get(set_stem(table))))
    for pages in made:
        stem = pages.stem
        add_script(files, stem, pages.found.data)
        titles = {row.method: row.label for row in pages.table.rows}
        browser = write_queries(stem, pages.found.ranked, titles, pictures.get(pages.set_stem, {}), artefacts, files)
        add_script(files, f"{stem}-queries", browser | {"failed": pages.found.failed})
        files[f"{stem}.html"] = table_page(pages, made).encode()
        files[f"{stem}-forms.html"] = forms_page(pages, made).encode()
        files[f"{stem}-queries.html"] = queries_page(pages, made).encode()
    files["index.html"] = index_page(made, command, boards).encode()
    return Written(
        folder.write(files),
        len(files),
        sum(map(len, files.values())),
        sum(gallery.n_forms for gallery in galleries.values() if gallery is not None),
        sum(pages.found.n_distances for pages in made),
        sum(len(pages.found.ranked) for pages in made),
    )


def _assets() -> Files:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ConfigurationError("plotly, which draws the charts, is not installed", "pip install plotly") from error
    own = resources.files("benchmark.report.html").joinpath("assets")
    files = {f"parts/assets/{name}": own.joinpath(name).read_bytes() for name in _ASSETS}
    return files | {"parts/assets/plotly.js": get_plotlyjs().encode()}


def _by_set(tables: Iterable[TableContent]) -> dict[str, list[Record]]:
    """Records with scores by data set, each once: tables share data sets, and records."""
    found: dict[str, dict[str, Record]] = {}
    for table in tables:
        here = found.setdefault(set_stem(table), {})
        for record in (record for row in table.rows for cell in row.cells.values() for record in cell.records):
            here.setdefault(record["key"], dict(record))
    return {stem: list(records.values()) for stem, records in found.items() if records}


def _shapes_per_set(sets: dict[str, list[Record]]) -> int:
    """Return how many shapes of each data set may be shown with the forms of all methods."""
    return max(2, min(MOST_SHAPES, MOST_FORMS // max(_columns(sets), 1)))


def _columns(sets: dict[str, list[Record]]) -> int:
    """Return how many forms there are of a shape of each data set together."""
    return sum(len({(r["input"], r["method"]) for r in records}) for records in sets.values())

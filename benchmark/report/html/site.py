"""The whole report: pages, and the data that they load when it is wanted."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources

from benchmark.errors import ConfigurationError
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.html import pages as html
from benchmark.report.html.folder import Folder, Progress
from benchmark.report.html.gallery import Gallery, make_gallery
from benchmark.report.html.measured import Measured, measured
from benchmark.report.html.queries import write_queries
from benchmark.report.html.scripts import data_script
from benchmark.report.html.thumbnails import write_thumbnails
from benchmark.storage.environment import in_words
from benchmark.storage.keys import digest
from benchmark.storage.records import Record
from benchmark.system.text import brief

#: Forms in the whole report, at 13 kilobytes each: with plotly and the queries it stays below thirty megabytes.
MOST_FORMS = 1200

#: Shapes of a data set whose forms are shown at most.
MOST_SHAPES = 24

_ASSETS = ("report.css", "report.js", "charts.js", "forms.js", "queries.js")


@dataclass(frozen=True)
class Written:
    """Files of a report.

    Parameters
    ----------
    n_files, size
        Files and bytes.
    n_forms
        Canonical forms that can be turned.
    n_distances, n_ranked
        Jobs whose distances were here, of those with scores.
    """

    n_files: int
    size: int
    n_forms: int
    n_distances: int
    n_ranked: int


def write_report(
    tables: Sequence[TableContent],
    artefacts: ArtefactReader,
    folder: Folder,
    command: str,
    say: Progress = lambda _: None,
) -> Written:
    """Write the report into its folder.

    Parameters
    ----------
    tables
        The tables to show.
    kept
        Where distances, surfaces and forms are, as far as they are here; without them the report shows the records.
    folder
        Where it goes.
    command
        The command line that made it.
    say
        Told what is being done.

    Raises
    ------
    BenchmarkError
        If a file cannot be written or would take the place of what is of no report, or plotly is not installed.
    """
    names = [f"{table.file_stem}{ending}.html" for table in tables for ending in ("", "-forms", "-queries")]
    folder.claim(["index.html", "parts", *names])
    _write_assets(folder)
    sets = _by_set(tables)
    per_set = _shapes_per_set(sets)
    galleries: dict[str, Gallery | None] = {}
    pictures: dict[str, dict[str, int]] = {}
    for stem, records in sets.items():
        say(f"drawing {records[0]['data']['name']}")
        galleries[stem] = make_gallery(stem, records, artefacts, folder, most_shapes=per_set)
        pictures[stem] = write_thumbnails(stem, records, artefacts, folder)
    made: list[tuple[html.TablePages, Measured]] = []
    for table in tables:
        say(f"ranking {table.data['name']}")
        found = measured(table, artefacts)
        made.append((pages_of(table, found, galleries.get(_stem(table))), found))
    all_pages = [pages for pages, _ in made]
    for pages, found in made:
        stem, set_stem = pages.stem, _stem(pages.table)
        folder.write(f"parts/data/{stem}.js", data_script(stem, found.data))
        titles = {row.method: row.label for row in pages.table.rows}
        browser = write_queries(stem, found.ranked, titles, pictures.get(set_stem, {}), artefacts, folder)
        folder.write(f"parts/data/{stem}-queries.js", data_script(f"{stem}-queries", browser))
        gallery = galleries.get(set_stem)
        folder.write(f"{stem}.html", html.table_page(pages, all_pages))
        shown = gallery.as_json() if gallery is not None else None
        folder.write(f"{stem}-forms.html", html.forms_page(pages, all_pages, shown))
        folder.write(f"{stem}-queries.html", html.queries_page(pages, all_pages, set_stem))
    hero = {pages.stem: path for pages, _ in made if (path := _hero(galleries.get(_stem(pages.table)))) is not None}
    folder.write("index.html", html.index_page(all_pages, overview(all_pages, command), hero))
    folder.finish()
    return Written(
        len(folder.sizes),
        folder.size,
        sum(gallery.n_forms for gallery in galleries.values() if gallery is not None),
        sum(found.n_distances for _, found in made),
        sum(len(found.ranked) for _, found in made),
    )


def _write_assets(folder: Folder) -> None:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ConfigurationError("plotly, which draws the charts, is not installed", "pip install plotly") from error
    own = resources.files("benchmark.report.html").joinpath("assets")
    for name in _ASSETS:
        folder.write(f"parts/assets/{name}", own.joinpath(name).read_text(encoding="utf-8"))
    folder.write("parts/assets/plotly.js", get_plotlyjs())


def _records(table: TableContent) -> list[Record]:
    """Records with scores, in the order of the rows."""
    return [dict(record) for row in table.rows for cell in row.cells.values() for record in cell.records]


def _stem(table: TableContent) -> str:
    """Name of the files of a data set."""
    data = table.data
    return f"set-{digest([data['source'], data['name'], bool(data['quick'])])[:10]}"


def _by_set(tables: Iterable[TableContent]) -> dict[str, list[Record]]:
    """Records with scores by data set, each once: tables share data sets, and records."""
    found: dict[str, dict[str, Record]] = {}
    for table in tables:
        here = found.setdefault(_stem(table), {})
        for record in _records(table):
            here.setdefault(record["key"], record)
    return {stem: list(records.values()) for stem, records in found.items() if records}


def _shapes_per_set(sets: dict[str, list[Record]]) -> int:
    """Return how many shapes of each data set may be shown with the forms of all methods."""
    columns = sum(len({(r["input"], r["method"]) for r in records}) for records in sets.values())
    return max(2, min(MOST_SHAPES, MOST_FORMS // max(columns, 1)))


def pages_of(table: TableContent, found: Measured, gallery: Gallery | None = None) -> html.TablePages:
    """Return what the pages of a table are made of."""
    phases: dict[str, None] = {}
    cells = [(row["title"], input_, cell) for row in found.data["rows"] for input_, cell in row["inputs"].items()]
    for _, _, cell in cells:
        phases |= dict.fromkeys(cell["phases"])
    costs = [
        [
            title,
            input_,
            *(_seconds(cell["phases"].get(phase)) for phase in phases),
            _seconds(cell["seconds"]),
            cell["peak"] or "",
        ]
        for title, input_, cell in cells
    ]
    return html.TablePages(
        table, gallery is not None, len(found.ranked), found.n_distances, _run(table), costs, list(phases)
    )


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _run(table: TableContent) -> str:
    """The command that runs the jobs of a table here."""
    known = table.has_paper or table.table.identifier != table.data["name"]
    chosen = ["-t", table.table.part_of or table.identifier] if known else ["-d", str(table.data["source"])]
    scorer = ["--scorer", table.scorer] if table.scorer else []
    methods = [word for row in table.rows if any(c.records for c in row.cells.values()) for word in ("-m", row.method)]
    quick = ["--quick"] if table.quick else []
    return shlex.join(["python", "-m", "benchmark", "run", *chosen, *quick, *scorer, *methods])


def _hero(gallery: Gallery | None) -> str | None:
    return f"parts/pictures/hero-{gallery.stem}.webp" if gallery is not None and gallery.has_hero else None


def overview(tables: Sequence[html.TablePages], command: str) -> html.Overview:
    """Return what the first page tells of all tables together."""
    failures: list[list[object]] = []
    left_out: list[list[object]] = []
    environments: dict[str, int] = {}
    data: dict[str, list[object]] = {}
    keys: set[str] = set()
    finished: list[str] = []
    for pages in tables:
        table = pages.table
        what = table.data_title
        data.setdefault(what, [str(table.data["name"]), what, table.data["n_shapes"], table.data["n_classes"]])
        for row in table.rows:
            for input_, cell in row.cells.items():
                if cell.status not in ("ok", "missing"):
                    reason = brief(cell.record.get("reason", ""))
                    failures.append([pages.short, row.title, input_, cell.status, reason])
                for shape, why in cell.record.get("unsupported", ()):
                    left_out.append([pages.short, row.title, input_, str(shape), brief(why)])
                for record in cell.records:
                    if record["key"] in keys:
                        continue
                    keys.add(record["key"])
                    finished.append(str(record.get("finished", "")))
                    for made in record.get("environments", ()):
                        told = in_words(made.get("environment", ""))
                        environments[told] = environments.get(told, 0) + int(made.get("artefacts", 0))
    runs = list(dict.fromkeys(pages.run for pages in tables))
    dates = sorted(filter(None, finished))
    facts = {"Jobs with scores": str(len(keys))}
    facts |= {"Finished": f"{dates[0]} to {dates[-1]}"} if dates else {}
    return html.Overview(
        failures,
        left_out[:500],
        [[told, count] for told, count in sorted(environments.items())],
        list(data.values()),
        [*runs, command],
        facts,
    )

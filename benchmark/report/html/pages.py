"""The report: pages, and the data that they load on demand. Templates escape all values."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from markupsafe import Markup

from benchmark.datasets.own import is_own
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.environment import in_words
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import EXTERNAL, Record
from benchmark.plugins.parameters import split_name
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.escaping import BLANK, environment, html_line, html_text, millionths, number
from benchmark.report.frame import Style, lines
from benchmark.report.html.data import chart_data
from benchmark.report.html.forms import DrawnSet, Files, Progress, add_script, draw_set, script_json
from benchmark.report.notes import notes
from benchmark.report.output import Folder
from benchmark.report.rankings import RankedCell, poses_of, ranked_cells
from benchmark.report.reproduction import reproduced_figures
from benchmark.report.significance import CONTROL
from benchmark.text import brief
from retrieval.measures import MEASURES, PRINTED

#: List of the files of a report, so that the next report can remove those that it no longer writes.
CONTENTS = "parts/contents.json"

#: Maximum number of forms in 3D (13 kB each), and of shapes of a data set side by side.
_MOST_FORMS, _MOST_SHAPES = 1200, 24

#: Maximum number of omitted shapes listed on the first page.
_MOST_LEFT_OUT = 500

_ASSETS = ("report.css", "report.js", "charts.js", "forms.js")


@dataclass(frozen=True)
class Written:
    """Summary of a written report: edited files that were kept, and numbers of files, bytes, forms and jobs."""

    edited: list[str]
    n_files: int
    size: int
    n_forms: int
    n_distances: int
    n_ranked: int


@dataclass(frozen=True)
class TablePages:
    """Content of the pages of one table, with the options and methods for their commands."""

    table: TableContent
    cells: list[RankedCell]
    drawn: DrawnSet
    options: tuple[str, ...] = ()
    known: Container[str] = ()

    @property
    def stem(self) -> str:
        """Name of the pages."""
        return self.table.file_stem

    @property
    def short(self) -> str:
        """Name of the table in the navigation."""
        identifier, name = self.table.identifier, str(self.table.data["name"])
        return identifier if identifier == name else f"{identifier} · {name}"

    @property
    def heading(self) -> str:
        """Name of the table."""
        identifier, caption = self.table.identifier, self.table.caption
        return caption if identifier == str(self.table.data["name"]) else f"Table {identifier}. {caption}"

    @property
    def n_ranked(self) -> int:
        """Number of jobs with scores."""
        return sum(len(cell.galleries) for cell in self.cells)

    @property
    def n_distances(self) -> int:
        """Number of jobs whose distances are stored."""
        return sum(gallery.ranking is not None for cell in self.cells for gallery in cell.galleries)

    @cached_property
    def has_poses(self) -> bool:
        """Whether all classes have the same poses."""
        return bool(poses_of(self.cells))

    @property
    def best(self) -> list[tuple[str, str, float]]:
        """Input, method and score of the highest DCG for each input, without controls and incomplete rows."""
        contest = [
            (cell.line.input, cell.line.label, cell.line.scores["DCG"])
            for cell in self.cells
            if cell.line.family != CONTROL and cell.line.coverage >= 1
        ]
        of_inputs = ([one for one in contest if one[0] == input_] for input_ in self.table.inputs)
        return [max(rows, key=lambda one: millionths(one[2])) for rows in of_inputs if rows]

    @property
    def run(self) -> str:
        """Command that runs the jobs of the table; "" if all belong to plugins that were not passed."""
        table, name = self.table, str(self.table.data["name"])
        source = name if is_own(str(table.data["source"])) else str(table.data["source"])
        known = table.has_paper or table.table.identifier != name
        chosen = ["-t", table.table.part_of or table.identifier] if known else []
        chosen += ["-d", source] if not known or table.table.stand_in else []  # official data may be there as well
        chosen += ["--quick"] * table.quick
        chosen += ["--scorer", table.scorer] if table.scorer else []
        chosen += ["--seed", str(table.seed)] if table.seed else []
        ours = (cell.line.method for cell in self.cells if cell.line.family != EXTERNAL)
        methods = [method for method in dict.fromkeys(ours) if (split_name(method) or ("",))[0] in self.known]
        if self.cells and not methods:
            return ""
        words = (word for method in methods for word in ("-m", method))
        return shlex.join(["python", "-m", "benchmark", "run", *chosen, *words, *self.options])

    @property
    def reproduction(self) -> list[list[object]]:
        """Scores of the paper and ours, with outcomes."""
        figures = reproduced_figures([self.table]).dropna(subset="ours")
        shown = figures[["title", "input", "measure", "outcome", "paper", "ours"]]
        return [[*facts, number(paper), number(ours)] for *facts, paper, ours in shown.to_numpy().tolist()]

    def costs(self) -> tuple[list[str], list[list[object]]]:
        """Return headings and rows of the table of costs: method, input, seconds by phase, their sum, peak memory."""
        by_phase = [cell.line.phases for cell in self.cells]
        phases = list(dict.fromkeys(phase for seconds in by_phase for phase in seconds))
        rows = [
            [
                cell.line.label, cell.line.input, *map(_seconds, [*map(seconds.get, phases), cell.line.seconds]),
                cell.line.peak_mib or "",
            ]
            for cell, seconds in zip(self.cells, by_phase, strict=True)
        ]  # fmt: skip
        return ["Method", "Input", *(f"{name}, s" for name in phases), "All, s", "Peak, MiB"], rows


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def write_report(
    tables: Sequence[TableContent],
    artefacts: ArtefactReader,
    root: Path,
    command: str,
    say: Progress = lambda _: None,
    *,
    options: Sequence[str] = (),
    force: bool = False,
) -> Written:
    """Write the report into its folder.

    Parameters
    ----------
    tables
        The tables to show.
    artefacts
        Reader of stored distances, surfaces and forms; without them, the report shows only records.
    root
        Folder of the report.
    command
        The command line that writes it.
    say
        Progress callback.
    options
        Options for plugins, data and results in the commands on the pages.
    force
        Whether to replace files that were edited or that no report has written.

    Raises
    ------
    BenchmarkError
        If a file cannot be written, would replace a file of another origin, or plotly is not installed.
    """
    names = [f"{table.file_stem}{ending}.html" for table in tables for ending in ("", "-forms")]
    folder = Folder(root, "report", CONTENTS, force)
    folder.require_own(["index.html", *names])
    files = _assets()
    sets: dict[str, dict[str, Record]] = {}  # tables share data sets, and records
    for table in tables:
        records = (record for line in table.lines for record in line.records)
        sets.setdefault(set_stem(table), {}).update((record["key"], dict(record)) for record in records)
    n_columns = max(1, sum(len({(r["input"], r["method"]) for r in of_set.values()}) for of_set in sets.values()))
    room = max(2, min(_MOST_SHAPES, _MOST_FORMS // n_columns))
    drawn = {}
    for stem, of_set in sets.items():
        say(f"drawing {next((record['data']['name'] for record in of_set.values()), 'nothing')}")
        drawn[stem] = draw_set(stem, list(of_set.values()), artefacts, files, room)
    all_pages = []
    for table in tables:
        say(f"ranking {table.data['name']}")
        cells = ranked_cells(table, artefacts)
        all_pages.append(TablePages(table, cells, drawn[set_stem(table)], tuple(options), artefacts.known))
    for pages in all_pages:
        add_script(files, pages.stem, chart_data(pages.table, pages.cells))
        files |= {name: text.encode() for name, text in table_pages(pages, all_pages).items()}
    files["index.html"] = index_page(all_pages, command).encode()
    return Written(
        folder.write(files),
        len(files),
        sum(map(len, files.values())),
        sum(of_set.n_forms for of_set in drawn.values()),
        sum(pages.n_distances for pages in all_pages),
        sum(pages.n_ranked for pages in all_pages),
    )


def set_stem(table: TableContent) -> str:
    """Return the prefix of the file names for the data set of a table."""
    data = table.data
    return f"set-{digest([data['source'], data['name'], bool(data['quick'])])[:10]}"


def table_pages(pages: TablePages, tables: Sequence[TablePages]) -> dict[str, str]:
    """Return the pages of one table by name: scores with charts, and canonical forms."""
    headings, costs = pages.costs()
    families = list(dict.fromkeys(row.family for row in pages.table.rows))
    content = {"lines": lines(pages.table), "notes": notes(pages.table), "cost_headings": headings, "costs": costs}
    gallery = {"gallery": pages.drawn.as_json()} if pages.drawn.n_forms else {}
    return {
        f"{pages.stem}.html": _page("table.html", tables, pages, {"table": pages.stem}, families=families, **content),
        f"{pages.stem}-forms.html": _page("forms.html", tables, pages, gallery),
    }


def index_page(tables: Sequence[TablePages], command: str) -> str:
    """Return the first page: tables, failures, and the commands that produce them."""
    placed = [((pages.short, line.title, line.input), line) for pages in tables for line in pages.table.lines]
    failures = [
        [*place, line.status, brief(line.reason)] for place, line in placed if line.status not in ("ok", "missing")
    ]
    left_out = [[*place, str(shape), brief(reason)] for place, line in placed for shape, reason in line.unsupported]
    records = {record["key"]: record for _, line in placed for record in line.records}
    environments: Counter[str] = Counter()
    for record in records.values():
        for part in record.get("environments", ()):
            environments[in_words(part.get("environment", ""))] += int(part.get("artefacts", 0))
    dates = sorted(str(record["finished"]) for record in records.values() if record.get("finished"))
    data: dict[str, list[Any]] = {}
    for table in (pages.table for pages in tables):  # several tables may show parts of the same data
        galleries = [record for line in table.lines for record in line.records]
        counts = (len({name for gallery in galleries for name in gallery[part]}) for part in ("shapes", "labels"))
        row = [table.data["name"], *map(max, counts, (table.data["n_shapes"], table.data["n_classes"]))]
        data[table.data_title] = max(data.get(table.data_title, row), row, key=lambda row: row[1])
    return _page(
        "index.html",
        tables,
        failures=failures,
        left_out=left_out[:_MOST_LEFT_OUT],
        data_sets=[[str(name), title, *sizes] for title, (name, *sizes) in data.items()],
        environments=sorted(environments.items()),
        commands=[*dict.fromkeys(pages.run for pages in tables if pages.run), command],
        facts={"Jobs with scores": str(len(records))} | ({"Finished": f"{dates[0]} to {dates[-1]}"} if dates else {}),
    )


def _page(
    name: str, tables: Sequence[TablePages], pages: TablePages | None = None, data: object = None, **content: Any
) -> str:
    return ENVIRONMENT.get_template(name).render(tables=tables, pages=pages, data=data, **content)


def _assets() -> Files:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ConfigurationError("plotly, which draws the charts, is not installed", "pip install plotly") from error
    own = resources.files("benchmark.report.html").joinpath("assets")
    files = {f"parts/assets/{name}": own.joinpath(name).read_bytes() for name in _ASSETS}
    return files | {"parts/assets/plotly.js": get_plotlyjs().encode()}


#: All values in templates are cleaned and escaped, except markup.
ENVIRONMENT = environment("benchmark.report.html", html_text)
ENVIRONMENT.filters |= {
    "json": lambda value: Markup(script_json(value)),
    "line": html_line,
    "number": number,
    "styled": Style(Markup("<b>{}</b>"), Markup("<i>{}</i>")).write,
}
ENVIRONMENT.globals |= {
    "site_title": "Canonical forms benchmark",
    "blank": BLANK,
    "measures": [measure for measure in MEASURES if measure.name in PRINTED],
    "measure_titles": {measure.name: measure.title for measure in MEASURES},
}

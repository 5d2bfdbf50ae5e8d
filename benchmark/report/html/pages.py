"""The pages of the report: what their templates are filled with. The environment escapes all that comes from data."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmark.pipeline.storage.environment import in_words
from benchmark.pipeline.storage.keys import digest
from benchmark.report.content import TableContent
from benchmark.report.escaping import html_line, html_text
from benchmark.report.frame import Style, lines
from benchmark.report.html.gallery import Gallery
from benchmark.report.html.measured import Measured
from benchmark.report.html.scripts import script_json
from benchmark.report.notes import notes
from benchmark.report.rounding import BLANK, millionths, number
from benchmark.report.statistics.table_significance import CONTROL
from benchmark.text import brief
from retrieval.measures import MEASURES, PRINTED

#: Shapes that the first page lists as left out, at most.
_MOST_LEFT_OUT = 500


@dataclass(frozen=True)
class TablePages:
    """Content of the pages of one table.

    Parameters
    ----------
    table
        The table.
    found
        Data of its charts, and its rankings.
    gallery
        Pictures of canonical forms; None without any.
    """

    table: TableContent
    found: Measured
    gallery: Gallery | None = None

    @property
    def stem(self) -> str:
        """Name of the pages."""
        return self.table.file_stem

    @property
    def set_stem(self) -> str:
        """Name of the files of the data set."""
        return set_stem(self.table)

    @property
    def short(self) -> str:
        """Name of the table in the navigation."""
        identifier, name = self.table.identifier, str(self.table.data["name"])
        return identifier if identifier == name else f"{identifier} · {name}"

    @property
    def heading(self) -> str:
        """Name of the table."""
        identifier = self.table.identifier
        own = identifier == str(self.table.data["name"])
        return self.table.caption if own else f"Table {identifier}. {self.table.caption}"

    @property
    def best(self) -> list[tuple[str, str, float]]:
        """Input, method and score of the highest DCG under each input, controls aside."""
        found: list[tuple[str, str, float]] = []
        for input_ in self.table.inputs:
            contest = [
                (scores["DCG"], row.label)
                for row in self.table.rows
                if row.family != CONTROL and (cell := row.cells.get(input_)) and (scores := cell.scores)
            ]
            if contest:
                score, label = max(contest, key=lambda each: millionths(each[0]))
                found.append((input_, label, score))
        return found

    @property
    def run(self) -> str:
        """The command that runs the jobs of the table here."""
        table = self.table
        known = table.has_paper or table.table.identifier != table.data["name"]
        chosen = ["-t", table.table.part_of or table.identifier] if known else ["-d", str(table.data["source"])]
        scorer = ["--scorer", table.scorer] if table.scorer else []
        done = [row.method for row in table.rows if any(cell.records for cell in row.cells.values())]
        methods = [word for method in done for word in ("-m", method)]
        quick = ["--quick"] if table.quick else []
        return shlex.join(["python", "-m", "benchmark", "run", *chosen, *quick, *scorer, *methods])

    def costs(self) -> tuple[list[str], list[list[object]]]:
        """Headings and rows of the table of costs: method, input, seconds by phase, their sum, peak memory."""
        cells = [(row["title"], name, cell) for row in self.found.data["rows"] for name, cell in row["inputs"].items()]
        phases = list(dict.fromkeys(phase for *_, cell in cells for phase in cell["phases"]))
        rows = [
            [title, input_, *map(_seconds, [*map(cell["phases"].get, phases), cell["seconds"]]), cell["peak"] or ""]
            for title, input_, cell in cells
        ]
        return ["Method", "Input", *(f"{name}, s" for name in phases), "All, s", "Peak, MiB"], rows


@dataclass(frozen=True)
class Board:
    """Rows of bundles on one gallery: a heading, and a row of cells for each record."""

    heading: str
    rows: list[list[object]]


def set_stem(table: TableContent) -> str:
    """Return the name of the files of the data set of a table."""
    data = table.data
    return f"set-{digest([data['source'], data['name'], bool(data['quick'])])[:10]}"


def index_page(tables: Sequence[TablePages], command: str, boards: Sequence[Board] = ()) -> str:
    """Return the first page: the tables, rows of bundles, what failed, and the commands that made all of it."""
    return _rendered("index.html", tables, boards=boards, **_overview(tables, command))


def table_page(pages: TablePages, tables: Sequence[TablePages]) -> str:
    """Return the scores of one table, and the charts that go with them."""
    families = list(dict.fromkeys(row.family for row in pages.table.rows))
    headings, costs = pages.costs()
    told = {"lines": lines(pages.table), "notes": notes(pages.table), "cost_headings": headings, "costs": costs}
    return _rendered("table.html", tables, pages=pages, data={"table": pages.stem}, families=families, **told)


def forms_page(pages: TablePages, tables: Sequence[TablePages]) -> str:
    """Return the canonical forms of some shapes, and a viewer of each."""
    data = {"gallery": pages.gallery.as_json()} if pages.gallery else {}
    return _rendered("forms.html", tables, pages=pages, data=data)


def queries_page(pages: TablePages, tables: Sequence[TablePages]) -> str:
    """Return the browser of queries."""
    return _rendered("queries.html", tables, pages=pages, data={"queries": pages.stem})


def _rendered(name: str, tables: Sequence[TablePages], **told: Any) -> str:
    return ENVIRONMENT.get_template(name).render({"tables": tables, "pages": None, "data": {}} | told)


#: What a template prints is cleaned and escaped, whatever it is; what is markup already stays.
ENVIRONMENT = Environment(
    loader=PackageLoader("benchmark.report.html"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=html_text,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
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


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _overview(tables: Sequence[TablePages], command: str) -> dict[str, Any]:
    """Return what is told of all tables together: rows of the tables of the first page, commands, and facts."""
    failures: list[list[object]] = []
    left_out: list[list[object]] = []
    environments: dict[str, int] = {}
    data: dict[str, list[object]] = {}
    records: dict[str, str] = {}
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
                    if record["key"] in records:
                        continue
                    records[record["key"]] = str(record.get("finished", ""))
                    for made in record.get("environments", ()):
                        told = in_words(made.get("environment", ""))
                        environments[told] = environments.get(told, 0) + int(made.get("artefacts", 0))
    dates = sorted(filter(None, records.values()))
    finished = {"Finished": f"{dates[0]} to {dates[-1]}"} if dates else {}
    return {
        "failures": failures,
        "left_out": left_out[:_MOST_LEFT_OUT],
        "data_sets": list(data.values()),
        "environments": sorted(environments.items()),
        "commands": [*dict.fromkeys(pages.run for pages in tables), command],
        "facts": {"Jobs with scores": str(len(records)), **finished},
    }

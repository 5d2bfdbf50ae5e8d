"""A column is one object: every format shows its heading and its cells."""

import re
from pathlib import Path

import pytest

from benchmark.report import columns, formats, notes, pages
from benchmark.report.columns import JOBS, OBJECTS, QUANTITIES, Column, median
from benchmark.report.formats import as_json, latex, markdown
from benchmark.report.notes import table_notes
from benchmark.report.pages import table_html
from benchmark.report.results import Results
from benchmark.report.tables import table_views
from tests.report.records import failed, record


@pytest.fixture
def memory(monkeypatch):
    """Another measured quantity, as an author of a column would add it."""

    def value(record):
        return record.notes["memory"].mean if "memory" in record.notes else None

    added = Column("memory", value, title="MiB", unit="most memory of a form", text="{:.0f}".format)
    printed = (*columns.PRINTED_QUANTITIES, median(added))
    for module in (columns, formats, pages):
        monkeypatch.setattr(module, "PRINTED_QUANTITIES", printed)
    monkeypatch.setattr(notes, "QUANTITIES", (*QUANTITIES, added))


def view():
    notes = {"memory": {"mean": 41.0, "max": 50.0}}
    [table] = table_views([record("gps", notes=notes), record("skeleton"), failed("mine")])
    return table


def test_markdown_shows_an_added_column(memory):
    rows = [line.split("|")[1:-1] for line in markdown(view()).splitlines() if line[:1] == "|"]
    assert rows[0][-2:] == ["s", "MiB"]
    assert {len(row) for row in rows} == {4}
    last = {row[0]: row[-1] for row in rows[2:] if not row[0].startswith("**")}
    assert last == {"GPS": "41", "Skeleton-based": "--", "Mine": "--", "*Random order*": ""}


def test_latex_has_as_many_cells_in_each_row_as_columns(memory):
    text = latex(view())
    spec = re.search(r"begin\{tabularx\}\{\\linewidth\}\{(.*)\}\n", text)[1]
    n_columns = 1 + 4 * spec.count("*{4}{c}") + len(re.search(r"(r+)@\{\}$", spec)[1])
    assert n_columns == 7
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and "emph" not in line]
    spans = [sum(int(n) - 1 for n in re.findall(r"multicolumn\{(\d+)\}", row)) for row in rows]
    assert [row.count("&") + 1 + n for row, n in zip(rows, spans, strict=True)] == [7] * len(rows)
    assert rf"\multicolumn{{{n_columns}}}{{@{{}}l}}" in text
    assert "s & MiB" in text


def test_html_has_as_many_cells_in_each_row_as_headings(memory):
    text = table_html(view())
    head, body = text.split("<tbody>")
    headings = head.split('<th scope="col">Method</th>')[1].count("<th ") + 1
    rows = [row for row in body.split("<tr")[1:] if 'class="block"' not in row[:20]]
    assert {row.count("<td") + row.count("<th") for row in rows} == {headings}
    assert f'<th scope="colgroup" colspan="{headings}">' in body
    assert 'title="most memory of a form">MiB</button>' in head


def test_notes_say_what_an_added_column_shows(memory):
    assert "MiB: most memory of a form; machine: unknown." in table_notes(view())[0]


def test_json_has_the_keys_on_which_programs_rely():
    [first, *_] = as_json([view()])
    assert list(first) == [column.key for column in OBJECTS]
    assert " ".join(first) == (
        "table dataset stand_in column scorer seed input method title NN FT ST DCG paper chance "
        "status n_shapes n_classes coverage seconds processor_seconds"
    )


def test_the_frame_of_jobs_has_a_column_for_each_fact_also_without_jobs():
    jobs = Results(Path(), (record("gps"), failed("mine"))).jobs
    assert list(jobs.columns) == [column.key for column in JOBS]
    assert jobs["NN"].isna().tolist() == [False, True]
    assert list(Results(Path(), ()).jobs.columns) == list(jobs.columns)

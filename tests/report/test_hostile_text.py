"""Whatever a name, a title or a reason holds: every format parses back, and shows it as text."""

import csv
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from benchmark.pipeline.storage.store import Store
from benchmark.protocols.tables import Table
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.escaping import csv_cell, html_text, latex_text, markdown_line, markdown_text
from benchmark.report.formats import render
from benchmark.report.frame import lines
from benchmark.report.html.data import chart_data
from benchmark.report.html.forms import DrawnSet, Sheets, add_script
from benchmark.report.html.pages import ENVIRONMENT, TablePages, index_page, table_pages
from benchmark.report.notes import notes
from benchmark.report.output import Folder
from benchmark.report.rankings import ranked_cells
from benchmark.report.results import Result
from benchmark.text import LONGEST_REASON, clean
from tests.records import failed, record

ANY = st.text(st.characters(codec=None, exclude_categories=()), max_size=30)
#: Text made of what means something somewhere.
MARKS = st.lists(
    st.sampled_from([*"|`*_[]()<>&#;!~$%^{}\\\"'=+-@.:1ab \n\x00\x1b\r\t", "&lt;", "<script>", "**", "](x)"])
)
TEXT = ANY | MARKS.map("".join)
HOSTILE = "\n".join(
    ["|<script>alert(1)</script>", "&amp;_%\\$#~^{}\x1b[31m\x00\ud800", "=1+1 \\end{table} **x** [a](b)"]
)

NOTHING_KEPT = ArtefactReader(Store(Path("nowhere")), {})

for template in ENVIRONMENT.list_templates():
    ENVIRONMENT.get_template(template)  # compiled once for all examples

MARKDOWN = MarkdownIt("commonmark", {"html": True}).enable("table").enable("strikethrough")


def plain(text):
    """A text as Markdown and HTML show it: blanks at both ends, and several in a row, do not count."""
    return " ".join(clean(text).split())


def inline(tokens):
    """Text of inline tokens, nothing but text among them."""
    assert {token.type for token in tokens} <= {"text", "text_special"}, [token.type for token in tokens]
    return " ".join("".join(token.content for token in tokens).split())


@given(TEXT)
@example(HOSTILE)
@example("\\|")
@example("a&#60;b &lt;")
def test_a_name_is_text_in_a_cell_of_markdown(text):
    table = f"| a | b |\n| --- | --- |\n| x{markdown_text(text)}x | y |\n"
    tokens = MARKDOWN.parse(table)
    cells = [token for token in tokens if token.type == "inline"]
    assert [token.type for token in tokens].count("td_open") == 2
    assert inline(cells[2].children) == plain(f"x{clean(text)}x")
    assert cells[3].content == "y"


@given(TEXT)
@example(HOSTILE)
@example("- a")
@example("1. a")
@example("# a")
@example("> a")
@example("```")
@example("---")
def test_a_sentence_is_one_item_of_a_list_in_markdown(text):
    tokens = MARKDOWN.parse(f"- {markdown_line(text)} end\n- next\n")
    assert [token.type for token in tokens if token.type.endswith("_open")] == [
        "bullet_list_open", "list_item_open", "paragraph_open", "list_item_open", "paragraph_open",
    ]  # fmt: skip
    first = next(token for token in tokens if token.type == "inline")
    assert {token.type for token in first.children} <= {"text", "text_special", "code_inline"}
    if "`" not in text:
        assert inline(first.children) == plain(f"{clean(text).strip()} end")


def unescaped(latex):
    """Text that LaTeX would show, after asserting that nothing in it is a command of its author."""
    shown = {
        r"\textbackslash{}": "\\", r"\textless{}": "<", r"\textgreater{}": ">", r"\textbar{}": "|", r"\dag{}": "†",
        r"$\pm$": "±", r"\textasciitilde{}": "~", r"\textasciicircum{}": "^", r"\&": "&", r"\%": "%", r"\$": "$",
        r"\#": "#", r"\_": "_", r"\{": "{", r"\}": "}", "-{}": "-",
    } | {rf"\textsuperscript{{{number}}}": digit for number, digit in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")}  # fmt: skip
    known = re.compile("|".join(map(re.escape, sorted(shown, key=len, reverse=True))))
    assert not re.search(r"[\\{}$&#^_%~|<>]", known.sub("", latex)), latex
    return known.sub(lambda found: shown[found[0]], latex)


@given(TEXT)
@example(HOSTILE)
@example("[1cm]")
@example("*")
def test_a_name_is_text_in_latex(text):
    told = latex_text(text)
    assert not told.lstrip().startswith(("[", "*"))
    assert unescaped(told.removeprefix("{}")) == clean(text)


class Reader(HTMLParser):
    """Tags and text of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.text = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)


@given(TEXT)
@example(HOSTILE)
@example("' onerror='x")
def test_a_name_is_text_in_html(text):
    reader = Reader()
    reader.feed(f"<p title='{html_text(text)}'>{html_text(text)}</p>")
    reader.close()
    assert [tag for tag, _ in reader.tags] == ["p"]
    assert reader.tags[0][1] == {"title": clean(text)}
    assert "".join(reader.text) == clean(text)


@given(TEXT)
@example(HOSTILE)
@example("=1+1")
@example(" @x")
def test_a_name_is_text_in_csv_and_no_formula(text):
    file = io.StringIO()
    csv.writer(file).writerow([csv_cell(text), csv_cell(-0.5)])
    ((told, number),) = csv.reader(io.StringIO(file.getvalue()))
    assert told in (clean(text), f"'{clean(text)}")
    assert not told.lstrip().startswith(("=", "+", "-", "@"))
    assert number == "-0.5"


def hostile_tables(text):
    """A table of a record with scores and one without, every name in them from outside."""
    data = {"name": text or "x", "title": text, "source": text}
    refused = [[f"{text}{k}", text] for k in range(5)]
    good = record(text or "m", title=text, family=text, unsupported=refused, data=data, gallery=text)
    bad = failed("failed", text, method=f"{text}2", title=text, data=data, gallery=text)
    return contents([Result(good, text), Result(bad)])


@given(TEXT)
@example(HOSTILE)
@example("000000" + "\x1b" * 5 + "\x08^\U00011cb7\U00012544\U00012544\U00018cd6\U0002ebe1\U0002ebe1")
def test_every_format_of_a_table_of_hostile_names_parses_back(text):
    (table,) = hostile_tables(text)
    files = render([table], ("latex", "markdown", "csv", "json"))
    names = [name for name in files if name not in ("references.bib", "tables.csv", "tables.json")]
    assert all(re.fullmatch(r"[\w.-]{1,120}", name) for name in files)
    for name, content in files.items():
        content.encode("utf-8")
        assert all(line.isprintable() for line in content.split("\n")), name
    wanted = {f"{table.file_stem}.md": (3 * 5, len(notes(table))), f"intervals-{table.file_stem}.md": (11, 3)}
    assert {name for name in names if name.endswith(".md")} == set(wanted)
    for name, (n_cells, n_notes) in wanted.items():
        tokens = MARKDOWN.parse(files[name])
        kinds = [token.type for token in tokens]
        assert kinds.count("table_open") == kinds.count("bullet_list_open") == 1
        assert kinds.count("td_open") == n_cells
        assert kinds.count("list_item_open") == n_notes
        assert not {"html_block", "heading_open", "fence", "code_block", "hr", "blockquote_open"} & set(kinds)
        inner = {child.type for token in tokens if token.type == "inline" for child in token.children}
        assert not inner & {"html_inline", "link_open", "image", "s_open"}
    (latex,) = (files[name] for name in names if name.endswith(".tex"))  # one input, and no paper to stand beside
    assert braces(latex) == 0
    assert len(re.findall(r"\\begin{table\*?}", latex)) == len(re.findall(r"\\end{table\*?}", latex)) <= 2
    body = latex[latex.index(r"\midrule") : latex.index(r"\bottomrule")].split("\n")
    assert sorted(len(re.findall(r"(?<!\\)&", line)) for line in body if line.endswith(r"\\")) == [
        1,
        4,
        4,
    ]  # a failed job has one cell
    assert re.fullmatch(r"% [\w.-]+, made from records [0-9a-f]{32}; needs booktabs and tabularx", latex.split("\n")[0])
    assert re.search(r"^\\label\{tab:[\w.-]+\}$", latex, re.MULTILINE)
    rows = list(csv.reader(io.StringIO(files["tables.csv"])))
    assert len(rows) == 3
    assert len({len(row) for row in rows}) == 1
    assert [row["title"] for row in json.loads(files["tables.json"])] == [text, text]
    cells = ranked_cells(table, NOTHING_KEPT)
    sheets = Sheets(text, {text: text}, reasons={text: {text: ""}})
    pages = TablePages(table, cells, DrawnSet(text, {text: [text]}, {"mesh": sheets}, 1), (text,))
    for name, told in (table_pages(pages, [pages]) | {"index": index_page([pages], text)}).items():
        told.encode("utf-8")
        reader = Reader()
        reader.feed(told)
        reader.close()
        scripts = [where for tag, where in reader.tags if tag == "script"]
        assert all(
            re.fullmatch(r"parts/assets/[a-z]+\.js", w.get("src", "")) or w.get("id") == "page-data" for w in scripts
        )
        assert "img" not in [tag for tag, _ in reader.tags], name
    reader = Reader()
    reader.feed(ENVIRONMENT.get_template("parts.html").module.score_table(lines(table)))
    tags = [tag for tag, _ in reader.tags]
    assert (tags.count("table"), tags.count("script"), tags.count("td"), tags.count("tr")) == (1, 0, 3 * 4 + 1, 5)
    files = {}
    add_script(files, text, chart_data(table, cells))
    (script,) = (data.decode() for data in files.values())
    assert script.isascii()
    assert not set("<>&\r") & set(script)
    assert json.loads(f"[{script.removeprefix('canonicalForms.receive(').removesuffix(');' + chr(10))}]")[0] == clean(
        text
    )


def braces(latex):
    """How many groups are left open; none may be closed that was not opened."""
    depth = 0
    for mark in re.findall(r"\\.|[{}]", latex):
        depth += {"{": 1, "}": -1}.get(mark, 0)
        assert depth >= 0
    return depth


def test_a_long_reason_is_cut_in_tables_and_whole_in_the_record():
    reason = "because " * 400
    bad = failed("failed", reason)
    (table,) = contents([Result(record("gps", unsupported=[["cat0", reason]]), reason), Result(bad)])
    for note in notes(table):
        assert len(note) < LONGEST_REASON + 100
    assert sum(reason[:400] in note for note in notes(table)) == 3
    assert bad["reason"] == reason


def test_a_folder_that_is_called_like_a_table_of_the_paper_is_none():
    (table,) = hostile_tables("I")
    assert (table.table.caption, table.has_paper, len(table.rows)) == ("Retrieval on I", False, 2)


def test_files_are_written_whole_with_the_rights_of_the_umask_and_compared(tmp_path):
    tables = hostile_tables(HOSTILE)
    tables = [replace(tables[0], table=Table(HOSTILE, HOSTILE, HOSTILE))]
    files = render(tables, ("latex", "markdown", "csv", "json"))
    (tmp_path / ".99999999-ab.tmp").write_text("half")
    folder, whole = Folder(tmp_path, "tables"), {name: text.encode() for name, text in files.items()}
    folder.write(whole)
    assert {path.name for path in tmp_path.iterdir()} == set(files)
    (tmp_path / "umask").write_text("")
    assert len({path.stat().st_mode for path in tmp_path.iterdir()}) == 1
    assert folder.stale(whole) == []
    (tmp_path / "tables.csv").write_bytes(b"\xff")
    (tmp_path / "tables.json").unlink()
    (tmp_path / "tables.json").mkdir()
    assert folder.stale(whole) == ["tables.csv", "tables.json"]


@pytest.mark.parametrize("cell", ["=cmd|' /C calc'!A0", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_formulas_of_known_attacks_are_text(cell):
    assert str(csv_cell(cell)).startswith("'")

"""Tables as Markdown, LaTeX, JSON and text: widths, rounding, hostile names."""

import io
import json
import math
import re
import shutil
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.cli.printing import print_markdown
from benchmark.errors import ConfigurationError
from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.reference.paper import entry_of, source_of
from benchmark.report.formats import (
    as_json,
    bibtex_of_tables,
    blocks,
    latex,
    latex_text,
    latex_title,
    markdown,
    markdown_text,
)
from benchmark.report.notation import hundredths, signed_hundredths, two_digits
from benchmark.report.tables import table_views
from tests.report.records import failed, record

HOSTILE = [
    "<script>alert(1)</script>",
    "</td><img src=x onerror=alert(1)>",
    "&lt;b&gt;",
    "a|b|c",
    "**bold**",
    "[x](http://y)",
    "`code`",
    "\\input{/etc/passwd}",
    "$x_{1}^2$",
    "50 % & more #1",
    "{\\bf x}",
    "~^_",
    "../../etc/passwd",
    "a\nb\tc",
    "\x1b[31mred\x1b[0m",
    "\x00\x07",
    "\u202egnp.exe",
    "'\"",
    "naïve café",
    "漢字 🐈",
]


def views():
    names = [
        name for name in HOSTILE if not re.search(r"[\x00-\x1f]", name)
    ]  # records refuse the others
    records = [record(f"m{k}", k / 20, title=name, dataset="tosca") for k, name in enumerate(names)]
    records += [
        failed("fell", reason, dataset="tosca") for reason in ["<b>\x1b[31m\n|*_$ \\end{table}"]
    ]
    return table_views([*records, record("gps", 0.5, dataset="tosca")])


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.125, ".13"),
        (0.004999, ".00"),
        (0.995, "1.00"),
        (1.0, "1.00"),
        (0.0, ".00"),
        (0.574999, ".57"),
        (0.575, ".58"),
        (math.nan, "--"),
        (None, "--"),
    ],
)
def test_scores_have_two_decimals_and_no_leading_zero(value, shown):
    assert hundredths(value) == shown


@pytest.mark.parametrize(
    ("difference", "shown"),
    [(0.345, "+.35"), (-0.345, "-.35"), (-0.344999, "-.34"), (-0.0049, "+.00"), (-1.0, "-1.00")],
)
def test_differences_are_rounded_as_scores_and_have_a_sign(difference, shown):
    assert signed_hundredths(difference) == shown


def test_durations_have_two_digits():
    assert [two_digits(x) for x in (0.004, 0.61, 3.94, 42.4)] == [
        ".00",
        ".61",
        "3.9",
        "42",
    ]


def test_every_name_is_text_in_markdown():
    shown = markdown(views()[0])
    table = [line for line in shown.splitlines() if line.startswith("|")]
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in table}) == 1
    assert "<" not in shown.replace("&lt;", "")
    assert "\x1b" not in shown
    assert "\\[x\\](http://y)" in shown


class Terminal(io.StringIO):
    def isatty(self):
        return True


def in_terminal(tables, width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr("sys.stdout", Terminal())
    print_markdown("\n".join(map(markdown, tables)))
    return re.sub(r"\x1b\[[0-9;]*m", "", sys.stdout.getvalue())


def test_every_name_is_text_in_a_terminal(monkeypatch):
    shown = in_terminal(views(), 80, monkeypatch)
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f\u202e]", shown)
    assert all(
        name in shown
        for name in ("<script>alert(1)</script>", "a|b|c", "**bold**", "[x](http://y)", "&lt;b&gt;")
    )


def test_latex_may_break_a_title_within_parameters_and_needs_no_help_elsewhere():
    assert (
        latex_title("m[k=1,size=.5]")
        == r"m{[}\allowbreak{}k=\allowbreak{}1,\allowbreak{}size=\allowbreak{}.5]"
    )
    assert latex_title("Non-metric MDS (all, none)") == "Non-metric MDS (all, none)"


def test_every_name_is_text_in_latex():
    shown = latex(views()[0]).replace(r"\allowbreak{}", "")
    assert "\\input" not in shown
    assert shown.count("\\end{table}") == 1
    assert "\\textbackslash{}input\\{/etc/passwd\\}" in shown


ENTRY = "@misc{me:26, title = {A {Method} of Mine}}"


def citing(**cites):
    return table_views(
        [record(name, cite=cite, dataset="tosca") for name, cite in cites.items()], ["III"]
    )


def test_rows_cite_their_sources_and_the_bibliography_holds_what_they_cite():
    shown = citing(gps="", mine=ENTRY, other="rustamov2007gps", none="", unknown="nobody2001")
    table, entries = latex(shown[0]), bibtex_of_tables(shown)
    cites = {
        "GPS": "rustamov2007gps",
        "Mine": "me:26",
        "Other": "rustamov2007gps",
        "Paper": "canonicalreconstruction",
    }
    assert dict(re.findall(r"(\w+)~\\cite\{(.+?)\}", table)) == cites
    assert sorted(re.findall(r"^@\w+\{(.*?),", entries, re.M)) == sorted({*cites.values()})
    assert ENTRY in entries
    (seed,) = re.findall(r"@misc\{canonicalreconstruction,.*?\n\}", entries, re.S)
    assert set(re.findall(r"^  (\w+)", seed, re.M)) == {
        "key",
        "title",
        "note",
    }  # nobody has told more


def test_two_entries_with_one_key_are_refused():
    with pytest.raises(ConfigurationError, match="'me:26' with different entries"):
        bibtex_of_tables(citing(mine=ENTRY, other=ENTRY.replace("Mine", "Hers")))


@pytest.mark.parametrize(
    "cite",
    [
        ENTRY[:-1],
        ENTRY + "}",
        ENTRY + ENTRY,
        ENTRY + " x",
        "@string{a, b}",
        "@misc{a b, c = {}}",
        "@misc{a}",
        "@misc{a, title = {\\input{/etc/passwd}}}",
        "@misc{a, title = {^^5cinput{x}}}",
    ],
)
def test_what_is_no_entry_is_not_cited(cite):
    assert entry_of(cite) == ("", "")


@given(st.text(max_size=30))
def test_latex_text_is_ascii_or_accented_and_has_no_open_group(words):
    shown = latex_text(words)
    assert all(ord(character) < 0x180 for character in shown)
    bare = re.sub(r"\\[{}&%$#_]", "", shown)
    assert bare.count("{") == bare.count("}") == len(re.findall(r"\\text\w+\{\}|\{[\[*]\}", shown))
    assert "|" not in re.sub(r"\\\|", "", markdown_text(words))


LONG = {"title": "A rather long title of a row", "stand_in_for": "shrec14-synthetic"}
WIDE = [
    record(name, 1.0, dataset=SYNTHETIC_HUMANS[0], fold=fold, **LONG)
    for name in ("gps", "a-method-of-mine", "skeleton")
    for fold in ("", "fold 0", "fold 1", "fold 2")
]


def test_markdown_fits_100_columns_and_a_terminal_80(monkeypatch):
    table = table_views(WIDE, ["I"])[0]
    assert max(map(len, markdown(table).splitlines())) <= 100
    shown = in_terminal([table], 80, monkeypatch)
    assert max(map(len, shown.splitlines())) <= 80
    assert re.search(r"GPS +\.40 \.20 \.32 \.56 +1\.00 +\.50 +\.60 +\.70\n", shown)
    assert re.search(r"GPS +1\.00 +\.50 +\.60 +\.70 +1\.5\n", shown)  # ranges need the room


def test_the_least_and_the_greatest_fold_stand_beside_the_mean():
    of_view = {"dataset": SYNTHETIC_HUMANS[0], "input_": "view"}
    records = [
        record(f"learned[training_seed={s}]", 0.2 * s, fold="fold 0", **of_view) for s in (1, 2)
    ]
    records += [
        record("learned", nn, fold=fold, **of_view)
        for nn, fold in ((0.6, "fold 1"), (0.7, "fold 2"), (0.5, ""))
    ]
    (table,) = table_views(records, ["I-view"])
    assert "|||.30-.70 .50-.50 .60-.60 .70-.70||" in markdown(table)
    assert r"$_{\mathrm{.30}}^{\mathrm{.70}}$ & .50$_{\mathrm{.50}}^{\mathrm{.50}}$ & " in latex(
        table
    )
    assert table.of_folds(table.rows[0], "15 subjects") == []
    (missing,) = table_views(records[:3], ["I-view"])
    assert missing.of_folds(missing.rows[0], "5 subjects")[0] == pytest.approx((0, 0.6))


def test_the_heading_of_networks_says_which_of_them_see_views():
    learned, field = (
        record("learned", dataset="tosca", input_="view"),
        record("deformation-field", dataset="tosca"),
    )
    for rows, seen in (
        ([learned], "one depth view"),
        ([learned, field], "one depth view unless named"),
    ):
        (table, *_) = table_views(rows, ["III"])
        assert [heading for heading, _ in blocks(table)] == [f"Networks ({seen})", ""]


def test_json_keeps_its_keys():
    (row, *_) = as_json(table_views([record("gps", 0.25, dataset="tosca")], ["III"], paper=True))
    assert json.loads(json.dumps(row)) == row
    assert row.keys() >= {
        "table",
        "dataset",
        "stand_in",
        "input",
        "method",
        "title",
        "NN",
        "FT",
        "ST",
        "DCG",
        "paper",
        "chance",
        "n_shapes",
        "n_classes",
        "coverage",
        "seconds",
        "status",
    }
    assert (row["method"], row["paper"]["NN"], row["seconds"]) == ("classic-mds", 0.74, None)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("pdflatex"), reason="no pdflatex")
@pytest.mark.parametrize("name", ["IEEEtran", "llncs", "article"])
def test_latex_compiles_without_an_overfull_box(tmp_path, name):
    if not subprocess.run(["kpsewhich", f"{name}.cls"], capture_output=True, check=False).stdout:
        pytest.skip(f"no {name}")
    body = "\n\\clearpage\n".join(latex(view) for view in (*views(), *table_views(WIDE)))
    shapes = [
        f"\\DeclareFontShape{{OT1}}{{ptm}}{{{a}}}{{{b}}}"
        f"{{<->ssub*cmr/{'bx' if a != 'm' else 'm'}/{b}}}{{}}"
        for a in ("m", "b", "bx")
        for b in ("n", "it")
    ]
    shapes += [shape.replace("{OT1}{ptm}", "{TS1}{ptm}") for shape in shapes]
    fonts = (
        ["\\DeclareFontFamily{OT1}{ptm}{}", "\\DeclareFontFamily{TS1}{ptm}{}", *shapes]
        if name == "IEEEtran"
        else []
    )  # Times is not everywhere
    preamble = [
        *fonts,
        f"\\documentclass{{{name}}}",
        "\\usepackage{booktabs,tabularx}",
        "\\begin{document}",
    ]
    (tmp_path / "paper.tex").write_text("\n".join([*preamble, body, "\\end{document}"]))
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "paper.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        errors="replace",
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout


@pytest.mark.parametrize(
    ("authors", "named"),
    [
        ("A. Ash", "A. Ash"),
        ("A. Ash and B. Birch", "A. Ash and B. Birch"),
        ("A. Ash and B. Birch and C. Cedar", "A. Ash, B. Birch and C. Cedar"),
    ],
)
def test_a_source_names_its_authors_its_year_and_where_it_stands(authors, named):
    entry = f"@article{{key, author = {{{authors}}}, title = {{Trees}}, year = 2014}}"
    assert source_of(entry) == f"{named} (2014). Trees"


def test_a_title_that_begins_with_a_star_is_no_part_of_the_row_before():
    r"""``\\*`` at the end of a row keeps it together with the next one, and shows no star."""
    text = latex(table_views([record("a"), record("b", title="*b")])[0])
    assert "\n{*}b & " in text

"""Golden tables from made-up records."""

from dataclasses import replace

import pytest
from pandas import concat

from benchmark.execution.plan import difference
from benchmark.plugins.registry import BUILT_IN, MethodSpec
from benchmark.protocols.tables import Table
from benchmark.report.content import TableContent, departs_of
from benchmark.report.formats import as_csv, markdown, rows_as_json
from benchmark.report.latex import latex
from benchmark.report.notes import notes
from benchmark.report.results import Result
from retrieval.chance import chance_levels
from tests.records import failed, record
from tests.report.tables import frame, line


def result(nn, unsupported=()):
    return Result(record(nn=nn, unsupported=list(unsupported)))


def table(quick=False, stand_in="tosca"):
    chance = chance_levels(["cat", "cat", "dog", "dog"])
    data = {"name": "beasts", "title": "Beasts & Co", "stand_in_for": stand_in, "quick": quick}
    paper = {"NN": 0.74, "FT": 0.54, "ST": 0.80, "DCG": 0.80}
    classic = {"title": "Classic MDS", "family": "paper", "paper": paper}
    fast, mine = classic | {"title": "Fast MDS"}, {"title": "50 % of_mine"}
    lines = (
        line("classic-mds", "mesh", result(0.7449), **classic),
        line("classic-mds", "view", result(0.2, [("cat1", "two parts; join them")]), **classic),
        line("fast-mds", "mesh", **fast),
        line("fast-mds", "view", **fast),
        line("mine", "mesh", result(0.7401), **mine),
        line("mine", "view", Result(failed()), **mine),
    )
    data |= {"n_shapes": 4, "n_classes": 2, "chance": chance}
    return TableContent(Table("III", "Animals", "tosca", "beasts"), data, ("mesh", "view"), frame(lines), chance, 1)


def test_markdown_marks_what_reads_as_best_and_names_stand_in_and_gaps():
    text = markdown(table(quick=True))
    lines = text.splitlines()
    assert lines[0] == "**Table III. Animals: generated stand-in 'beasts', not TOSCA (4 shapes, 2 classes).**"
    classic = [word.strip() for word in lines[4].strip("|").split("|")]
    assert classic == [
        "Classic MDS (view: coverage 0.80)",
        "0.74",
        "0.54",
        "0.80",
        "0.80",
        "**0.74**",
        "**0.50**",
        "**0.75**",
        "**0.80**",
        *("0.20", "0.50", "0.75", "0.80"),  # of some shapes alone: never the best
    ]
    mine = [word.strip() for word in lines[6].strip("|").split("|")]
    assert mine[5] == "**0.74**"  # 0.7401 and 0.7449 both print as 0.74
    assert mine[9] == "--"
    assert "| *Chance*" in lines[7]
    assert "- Quick run: some poses of each subject were omitted." in lines
    assert "- Classic MDS, view: 1 unsupported (cat1): two parts; join them" in lines
    assert "- 50 % of_mine, view: timeout: stopped" in lines
    assert len({len(line) for line in lines[2:8]}) == 1


def test_what_was_not_run_is_one_note():
    content = table()
    blank = frame(line(row.method, "mesh", title=row.title) for row in content.rows)
    lines = markdown(replace(content, frame=blank, inputs=("mesh",))).splitlines()
    assert [line for line in lines if line.startswith("- ")] == ["- Not run: Classic MDS, Fast MDS, 50 % of_mine."]


def test_a_table_of_one_input_says_what_was_run_on_the_other_alone():
    paper = {"family": "paper", "paper": dict.fromkeys(("NN", "FT", "ST", "DCG"), 0.5)}
    lines = (
        line("classic-mds", "mesh", title="Classic MDS", run_under=("view",), **paper),
        line("classic-mds", "view", result(0.5), title="Classic MDS", run_under=("view",), **paper),
        line("fast-mds", "mesh", title="Fast MDS", **paper),
        line("fast-mds", "view", title="Fast MDS", **paper),
    )
    complete = replace(table(), frame=frame(lines)).of("mesh")
    assert "Run only on the view input: Classic MDS." in notes(complete)
    assert [line for line in notes(complete) if line.startswith("Not run")] == ["Not run: Fast MDS."]


def test_latex_is_booktabs_escaped_and_stable():
    text = latex(table())
    assert text == latex(table())
    assert text.startswith("% table-III-beasts, made from records ")
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == 1
    assert r"\begin{tabular}{@{}l*{12}{r}@{}}" in text
    assert r"X*{12}{r}@{}}" in text  # where the text is too narrow for labels on one line
    assert r"\cmidrule(lr){2-5} \cmidrule(lr){6-9} \cmidrule(lr){10-13}" in text
    assert r"50 \% of\_mine & -- & -- & -- & -- & \textbf{0.74}" in text
    assert "generated stand-in 'beasts', not TOSCA" in text
    assert r"Chance & 0.33 & 0.33 & 0.67 & 0.88" in text
    for words in text.splitlines():
        assert words.startswith("%") or "%" not in words.replace(r"\%", "")
    body = text[text.index(r"\midrule") : text.index(r"\bottomrule")]
    cells = [line.replace(r"\multicolumn{4}{c}", " &  &  & ") for line in body.splitlines() if line.endswith(r"\\")]
    assert all(line.count(" & ") == 12 for line in cells)


def test_json_and_csv_hold_one_row_per_input_and_method():
    rows = rows_as_json([table()])
    assert [(row["input"], row["method"], row["status"]) for row in rows] == [
        ("mesh", "classic-mds", "ok"),
        ("mesh", "fast-mds", "missing"),
        ("mesh", "mine", "ok"),
        ("view", "classic-mds", "ok"),
        ("view", "fast-mds", "missing"),
        ("view", "mine", "timeout"),
    ]
    assert rows[0]["stand_in"] is True
    assert rows[0]["seconds"] == 1.5
    assert rows[1]["NN"] is None
    assert rows[2]["paper"] is None
    assert rows[3]["unsupported"] == 1
    lines = as_csv([table()]).splitlines()
    assert len(lines) == 7
    assert lines[0].startswith("table,dataset,stand_in,input,method,title,NN,FT,ST,DCG,paper_NN")


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        ({"seed": 0}, {"seed": 1}, "seed changed from 0 to 1"),
        ({"gallery": "a"}, {"gallery": "b"}, "the data changed"),
        ({"parameters": {"k": 1}}, {"parameters": {"k": 2}}, "parameters changed: k 1 -> 2"),
        (
            {"versions": {"method/gps": "1", "measures": "1"}},
            {"versions": {"method/gps": "2", "measures": "1"}},
            "versions changed: method/gps",
        ),
        ({"plugin": {"a.py": "1"}}, {"plugin": {"a.py": "2"}}, "plugin changed: a.py 1 -> 2"),
        ({"code": {}}, {"versions": {"measures": "1"}}, "made by version 0.2 or older"),
        ({}, {}, "the recipe changed"),
    ],
)
def test_a_stale_job_says_what_changed(before, now, said):
    assert difference(before, now) == said


def test_an_outdated_row_has_a_mark_and_a_note_that_says_what_changed():
    content = table()
    content.frame.at[0, "outdated"] = "libigl 2.6.2 -> 2.6.3"
    text = markdown(content)
    assert "| Classic MDS (view: coverage 0.80) † " in text
    assert text.count("†") == 2
    assert "- † Classic MDS: made before the last change (libigl 2.6.2 -> 2.6.3)" in text.splitlines()
    assert r"Classic MDS (view: coverage 0.80) \dag{} \cite{elad2003bending} & 0.74" in latex(content)
    assert rows_as_json([content])[0]["outdated"] == "libigl 2.6.2 -> 2.6.3"
    assert rows_as_json([content])[0]["title"] == "Classic MDS"
    assert "†" not in markdown(table())


def test_departures_from_sources_are_numbered_below_rows_with_scores():
    content = table()
    more = content.frame[content.frame["method"] == "mine"].assign(method="mine[a=1]")
    departs = {
        "classic-mds": "Fewer steps than in the source.",
        "fast-mds": "Not run, so not told.",
        "mine": "Three axes_of many.",
        "mine[a=1]": "Fewer steps than in the source.",
    }
    rows = concat([content.frame, more])
    departing = replace(content, frame=rows.assign(departs=rows["method"].map(departs)))
    assert notes(departing)[-2:] == ["¹ Fewer steps than in the source.", "² Three axes_of many."]
    assert notes(departing, most=1) == [f"{len(notes(departing))} more notes: 'tables' prints them."]
    labels = [line.split("|")[1].strip() for line in markdown(departing).splitlines() if line.startswith("| ")]
    assert [label[-1] for label in labels[2:6]] == ["¹", "S", "²", "¹"]
    text = latex(departing)
    assert r"50 \% of\_mine \textsuperscript{2}" in text
    assert r"\textsuperscript{2} Three axes\_of many." in text
    told = [row.get("departs") for row in rows_as_json([departing]) if row["input"] == "mesh"]
    assert told == [*departs.values()]


def test_methods_of_the_suite_say_how_they_depart_from_what_they_cite():
    said = {name: departs_of(name) for name in BUILT_IN}
    assert "level sets" in said["skeleton"]
    assert "Rustamov" in said["gps"]
    assert departs_of("least-squares-mds[start=classic]") == said["least-squares-mds"] != ""
    assert departs_of("of-a-plugin[a=1]") == ""
    cites = {name: MethodSpec(name, BUILT_IN[name]).info.cite for name in BUILT_IN}
    assert not [name for name, text in said.items() if text and not cites[name]]
    assert not [text for text in said.values() if text and (not text.endswith(".") or text.count(". ") > 1)]

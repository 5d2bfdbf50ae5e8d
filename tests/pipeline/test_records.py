"""Records are whole or absent, and what is no record harms nothing."""

import json
import os
from pathlib import Path

import pytest
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.html.data import chart_data
from benchmark.report.html.forms import DrawnSet, script_json
from benchmark.report.html.pages import TablePages, index_page, table_pages
from benchmark.report.rankings import ranked_cells
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.execution.plan import difference
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.record_schema import fault_of
from benchmark.pipeline.storage.records import Records, as_text, outcome, portable
from benchmark.pipeline.storage.store import Store
from benchmark.report.formats import render
from benchmark.report.results import Result
from tests.records import MEASURES, failed, record


@pytest.fixture
def records(tmp_path):
    return Records(tmp_path / "records")


def test_a_record_comes_back_as_it_was_and_a_later_one_replaces_it(records):
    first, second = record(nn=0.5), record(nn=0.75)
    assert first["key"] == second["key"]
    records.write(first)
    assert records.read(first["key"]) == first
    records.write(second)
    assert records.read(first["key"]) == second
    assert list(records) == [second]
    records.remove(first["key"])
    records.remove(first["key"])
    assert first["key"] not in records
    assert records.read(first["key"]) is None


def without(found, *path):
    """A copy of a record without one of its parts."""
    copied = json.loads(json.dumps(found))
    inner = copied
    for name in path[:-1]:
        inner = inner[name]
    del inner[path[-1]]
    return copied


GOOD = record()
PARTS = {
    "scorer": "cm-bof",
    "scorer_title": "CM-BOF",
    "codebook_deviation": dict.fromkeys(MEASURES, 0.01),
    "environments": [{"environment": "{}", "artefacts": 3}],
    "unsupported": [["cat0", "too thin"]],
    "unprepared": [],
    "coverage": 0.75,
    "supported": dict.fromkeys(MEASURES, 0.5),
    "seen": ["cat1"],
    "notes": {"bridges": {"mean": 1.0, "max": 2.0}},
}
#: A record with every part that one may have.
WHOLE = GOOD | PARTS
MODEL = {"training": "humans-fold-0", "data": "ten", "digest": "a", "schedule": "one pass", "extra_data": False}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
ALIENS = {
    "another object": {"a": 1},
    "a list": [GOOD],
    "a number": 7,
    "no data": without(GOOD, "data"),
    "data without a name": without(GOOD, "data", "name"),
    "no title": without(GOOD, "title"),
    "no scores": without(GOOD, "scores"),
    "a measure is missing": without(GOOD, "scores", "FT"),
    "no chance": without(GOOD, "chance"),
    "no cost": without(GOOD, "cost"),
    "no queries": without(GOOD, "per_query"),
    "a score beyond 1": {**GOOD, "scores": {**GOOD["scores"], "NN": 1.5}},
    "a score that is no number": {**GOOD, "scores": {**GOOD["scores"], "NN": "best"}},
    "a score that is NaN": {**GOOD, "scores": {**GOOD["scores"], "NN": float("nan")}},
    "queries of fewer shapes": {**GOOD, "per_query": {**GOOD["per_query"], "NN": [1.0]}},
    "labels of fewer shapes": {**GOOD, "labels": ["cat"]},
    "a huge score": {**GOOD, "scores": {**GOOD["scores"], "NN": 10**400}},
    "a score that is not the mean of its queries": {**GOOD, "scores": {**GOOD["scores"], "NN": 0.99}},
    "another level of chance": {**GOOD, "chance": {**GOOD["chance"], "NN": 0.1}},
    "a query beyond 1": {**GOOD, "per_query": {**GOOD["per_query"], "DCG": [0.5, 0.5, 1.001, 0.5]}},
    "a query below 0": {**GOOD, "per_query": {**GOOD["per_query"], "DCG": [0.5, 0.5, -0.001, 0.5]}},
    "more queries of a measure that is not printed": {**GOOD, "per_query": {**GOOD["per_query"], "E": [0.5] * 5}},
    "a chance beyond 1": {**GOOD, "chance": {**GOOD["chance"], "NN": 2}},
    "another number of shapes": {**GOOD, "n_shapes": 400},
    "another number of classes": {**GOOD, "n_classes": 1},
    "seconds in words": {**GOOD, "cost": {"seconds_per_shape": {"canonicalise": "long"}}},
    "unsupported without a reason": {**GOOD, "unsupported": [["cat0"]]},
    "models without a digest": {**GOOD, "models": [{"training": "humans-fold-0"}]},
    "a reason that is a list": {**GOOD, "reason": ["stopped"]},
    "stages as lists": {**GOOD, "recipe": {**GOOD["recipe"], "code": {"method": ["m"]}}},
    "another recipe than its key": {**GOOD, "recipe": {**GOOD["recipe"], "parameters": {"k": 1}}},
    "a number beyond all bounds": {**GOOD, "wall_seconds": float("inf")},
    "an unknown input": {**GOOD, "input": "touch"},
    "a seed in words": {**GOOD, "recipe": {**GOOD["recipe"], "seed": "zero"}},
    "no query has a value": {**GOOD, "per_query": dict.fromkeys(MEASURES, [None] * 4)},
    "a query has no value": {**GOOD, "per_query": {**GOOD["per_query"], "NN": [0.75, None, 0.75, 0.75]}},
    "scores without queries": {**GOOD, "scores": {**GOOD["scores"], "mAP": 0.9}},
    "one shape twice": {**GOOD, "shapes": ["cat0", "cat0", "dog0", "dog1"]},
    "one shape refused twice": {**WHOLE, "unsupported": [["cat0", "a"], ["cat0", "b"]], "coverage": 0.5},
    "another coverage than the shapes": {**WHOLE, "coverage": 1.0},
    "a coverage below that of the shapes": {**GOOD, "coverage": 0.5},
    "shapes without a result and no coverage": without(WHOLE, "coverage"),
    "a refused shape that is none": {**WHOLE, "unsupported": [["owl0", "too thin"]]},
    "an unprepared shape that was not refused": {**WHOLE, "unprepared": ["cat1"]},
    "seen shapes that are none": {**WHOLE, "seen": ["owl0"]},
    "deviations of another measure": {**GOOD, "codebook_deviation": {"mAP": 0.1}},
    "the title of a scorer without its name": {**GOOD, "scorer_title": "CM-BOF"},
    "artefacts in words": {**GOOD, "environments": [{"environment": "{}", "artefacts": "many"}]},
    "a NUL in the name of a set": {**GOOD, "data": {**GOOD["data"], "name": "ro\0ds"}},
    "a NUL in a source": {**GOOD, "data": {**GOOD["data"], "source": "ro\0ds"}},
    "a surrogate in the name of a set": {**GOOD, "data": {**GOOD["data"], "name": "ro\ud800ds"}},
    "a surrogate in a source": {**GOOD, "data": {**GOOD["data"], "source": "ro\ud800ds"}},
    "a NUL in the name of a shape": {**GOOD, "shapes": ["cat\0", "cat1", "dog0", "dog1"]},
    "a surrogate in a class": {**GOOD, "labels": ["\ud800", "\ud800", "dog", "dog"]},
    "a surrogate in a method": {**GOOD, "method": "g\ud800ps"},
    "a NUL in a gallery": {**GOOD, "gallery": "\0"},
    "the name of another job": {**GOOD, "key": "0" * 32},
}


def put_aliens(folder):
    """Lay everything into a folder of records that is none; returns the number of files that can be read."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(ALIENS.values()):
        key = f"{number:032x}"
        named = {**content, "key": key} if isinstance(content, dict) and content.get("key") == GOOD["key"] else content
        (folder / f"{key}.json").write_text(json.dumps(named))
    (folder / "half.json").write_text(json.dumps(GOOD)[:-9])
    (folder / "empty.json").write_text("")
    (folder / "bytes.json").write_bytes(b"\xff\xfe\x00")
    (folder / "deep.json").write_text("[" * 100_000 + "]" * 100_000)
    (folder / "huge.json").write_text(json.dumps({**GOOD, "key": "huge"}).replace('"NN": 0.75', '"NN": 1e999'))
    (folder / "digits.json").write_text("7" * 5000)
    (folder / "folder.json").mkdir()
    os.mkfifo(folder / "pipe.json")  # reading it would wait for ever
    (folder / "dangling.json").symlink_to(folder / "nowhere")
    (folder / "notes.txt").write_text("mine")


@pytest.mark.parametrize("name", [name for name in ALIENS if name != "the name of another job"])
def test_what_is_no_record_is_told(name):
    assert fault_of(GOOD) == fault_of(WHOLE) == ""
    assert fault_of(ALIENS[name])


def test_what_is_no_record_is_passed_over(records):
    put_aliens(records.folder)
    records.write(GOOD)
    records.write(failed(method="fast-mds"))
    assert {found["key"] for found in records} == {GOOD["key"], failed(method="fast-mds")["key"]}
    assert records.read("0" * 32) is None
    assert records.read("half") is None
    assert set(records.skipped) == {path.name for path in records.folder.glob("*.json")} - {
        f"{found['key']}.json" for found in (GOOD, failed(method="fast-mds"))
    }


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ('{"a": 1}', "it is not a record: Object missing required field `key`"),
        ("", "it is not JSON"),
        ("[" * 100_000, "it is not JSON"),
        ('{"a": NaN}', "it is not JSON"),
        (
            json.dumps({**GOOD, "scores": {**GOOD["scores"], "FT": 1.5}}),
            "it is not a record: Expected `float` <= 1.000000001 - at `$.scores[...]`",
        ),
        (json.dumps({**GOOD, "n_shapes": 400}), "'n_shapes' or 'n_classes' is not the number of its shapes or classes"),
        (
            json.dumps({**GOOD, "data": {**GOOD["data"], "quick": "yes"}}),
            "it is not a record: Expected `bool`, got `str` - at `$.data.quick`",
        ),
    ],
)
def test_the_reason_says_what_is_wrong_and_a_run_makes_the_record_again(records, content, why):
    records.folder.mkdir()
    path = records.folder / f"{GOOD['key']}.json"
    path.write_text(content)
    assert GOOD["key"] not in records
    assert records.read(GOOD["key"]) is None
    assert records.news() == [f"skipped {path}: {why}; remove it or move it elsewhere"]
    assert records.news() == []


def test_a_file_too_large_for_a_record_is_not_read(records, monkeypatch):
    monkeypatch.setattr("benchmark.pipeline.storage.records.LARGEST_FILE", 100)
    records.write(GOOD)
    assert list(records) == []
    assert records.skipped == {f"{GOOD['key']}.json": "it is too large"}


@pytest.mark.parametrize(
    "name", ["the title of a scorer without its name", "a surrogate in a source", "no query has a value"]
)
def test_a_bad_record_costs_its_own_row(tmp_path, name):
    bad, good = {**ALIENS[name], "key": GOOD["key"]}, record("gps")
    folder = tmp_path / "runs" / "records"
    folder.mkdir(parents=True)
    for each in (bad, good):
        (folder / f"{each['key']}.json").write_text(json.dumps(each))
    for words in (["tables"], ["tables", "-o", "tables"], ["report", "-o", "report"]):
        words[2:] = [str(tmp_path / place) for place in words[2:]]
        done = CliRunner().invoke(cli, [*words, "--results", str(tmp_path)])
        assert done.exit_code == 0, done.output
        assert f"skipped {folder / bad['key']}.json: " in done.output
    assert "Gps" in (tmp_path / "tables" / "table-rods.md").read_text()
    assert "Classic-Mds" not in (tmp_path / "tables" / "table-rods.md").read_text()


@given(st.data())
def test_no_part_of_a_record_can_be_replaced_by_something_that_ends_a_reader(data):
    """Whatever stands in the place of a part: either it is told, or every reader of the record takes it."""
    changed = json.loads(json.dumps(WHOLE | {"models": [MODEL]}))
    inner, name = changed, data.draw(st.sampled_from(sorted(changed)))
    while isinstance(inner[name], (dict, list)) and inner[name] and data.draw(st.booleans()):
        inner = inner[name]
        name = data.draw(st.sampled_from(sorted(inner) if isinstance(inner, dict) else range(len(inner))))
    inner[name] = data.draw(JSON)
    changed["key"] = digest(changed["recipe"])
    if fault_of(changed):
        return
    (table,) = contents([Result(changed)])
    render([table], ("latex", "markdown", "csv", "json"))
    cells = ranked_cells(table, ArtefactReader(Store(Path("nowhere")), {}))
    pages = TablePages(table, cells, DrawnSet("set"))
    script_json(chart_data(table, cells))
    table_pages(pages, [pages])
    index_page([pages], "report")
    as_text(portable(changed))
    difference(changed["recipe"], GOOD["recipe"])
    difference(GOOD["recipe"], changed["recipe"])


def test_a_failure_needs_no_scores_but_a_place():
    assert fault_of(failed()) == ""
    assert fault_of(without(failed(), "data")) == "it is not a record: Object missing required field `data`"
    assert fault_of({**failed(), "scores": GOOD["scores"]}) == "it has scores, and is not ok"
    assert "Expected `object`, got `str` - at `$.cost`" in fault_of({**failed(), "cost": "much"})


def test_the_outcome_is_what_came_out_wherever_and_whenever():
    same = record(finished="2027-01-01T00:00:00+00:00", peak_mib=1, wall_seconds=9.0, artefacts=["cd"])
    assert outcome(same) == outcome(record())
    assert outcome(record(nn=0.5)) != outcome(record(nn=0.75))
    assert outcome(record(labels=["a", "a", "b", "b"])) != outcome(record())


def test_a_folder_that_this_user_may_not_read_is_named(records, monkeypatch):
    records.write(GOOD)
    monkeypatch.setattr("os.access", lambda path, mode: path != records.folder)
    list(records)
    assert records.news() == [f"skipped {records.folder}: this user may not read it; change its rights"]

"""The report as files: complete from records alone, lazily loaded, escaped, and small."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmark.api.datasets import Entry
from benchmark.files import write_text
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.html.data import chart_data
from benchmark.report.html.forms import add_script, script_json
from benchmark.report.html.pages import CONTENTS, write_report
from benchmark.report.rankings import ranked_cells
from benchmark.report.results import Result
from retrieval.measures import PRINTED
from tests.records import SHAPES, failed, record
from tests.toy import rod

HOSTILE = "</script><script>alert(1)</script>\u2028\u2029\\\"'&<b>\ud800\x00"


def received(script):
    """Name and value of a script with data."""
    return json.loads(f"[{script.removeprefix('canonicalForms.receive(').rstrip().removesuffix(');')}]")


@pytest.fixture
def artefacts(tmp_path):
    return ArtefactReader(Store.open(tmp_path / "results"), methods())


def report(folder, artefacts, *records):
    tables = contents([Result(each) for each in records])
    return write_report(tables, artefacts, folder, "python -m benchmark report")


# Scripts with data ---------------------------------------------------------------------------------------------------


def test_no_string_ends_its_script_and_every_one_is_read_back_as_it_is_shown():
    files = {}
    add_script(files, HOSTILE, {HOSTILE: [HOSTILE, 1, None, float("nan"), np.float64(0.5), np.arange(2)]})
    (script,) = (data.decode() for data in files.values())
    assert script.isascii()
    assert not set("<>&") & set(script)
    name, value = received(script)
    assert name == script_json_text(HOSTILE)
    assert value == {name: [name, 1, None, None, 0.5, [0, 1]]}


def script_json_text(text):
    return json.loads(script_json(text))


# A whole report ------------------------------------------------------------------------------------------------------


def test_records_alone_make_a_report_that_says_what_brings_the_rest(artefacts, tmp_path):
    written = report(
        tmp_path / "out",
        artefacts,
        record("gps"),
        record("fast-mds", nn=0.5),
        failed("crashed", "it <b>fell</b>", method="fell"),
    )
    assert (written.n_forms, written.n_distances, written.n_ranked) == (0, 0, 2)
    names = {path.name for path in (tmp_path / "out").glob("*.html")}
    assert names == {"index.html", "table-rods.html", "table-rods-forms.html"}
    command = "python -m benchmark run -d rods -m gps -m fast-mds"
    for name in names - {"index.html"}:
        assert command in (tmp_path / "out" / name).read_text()
    index = (tmp_path / "out" / "index.html").read_text()
    assert "it &lt;b&gt;fell&lt;/b&gt;" in index
    assert "python -m benchmark report" in index


def test_no_page_asks_the_network_and_every_file_that_a_page_names_is_there(artefacts, tmp_path):
    report(tmp_path, artefacts, record("gps"))
    for page in tmp_path.glob("*.html"):
        text = page.read_text()
        assert not re.search(r"(src|href)=.?(https?:|//)", text)
        assert "width=device-width" in text
        for name in re.findall(r"(?:src|href)='([^'#]+)'", text):
            assert name.startswith("data:") or (tmp_path / name).is_file(), name
    style = (tmp_path / "parts" / "assets" / "report.css").read_text()
    assert "url(" not in style
    assert "@import" not in style


def test_only_failures_are_a_report_too(artefacts, tmp_path):
    written = report(
        tmp_path, artefacts, failed("memory", "too much", method="gps"), failed("timeout", "slow", method="fast-mds")
    )
    assert (written.n_ranked, written.n_forms) == (0, 0)
    assert "too much" in (tmp_path / "index.html").read_text()


def test_real_and_generated_data_stand_in_tables_of_their_own(artefacts, tmp_path):
    real = record("gps", gallery="tosca")
    generated = record("gps", gallery="animals", data={"name": "animals", "stand_in_for": "tosca"})
    report(tmp_path, artefacts, real, generated)
    index = (tmp_path / "index.html").read_text()
    assert "table-III-tosca.html" in index
    assert "table-III-animals.html" in index
    assert "generated stand-in &#x27;animals&#x27;, not TOSCA" in index


def test_a_set_has_the_shapes_of_its_largest_gallery(artefacts, tmp_path):
    whole = record("gps", gallery="tosca", data={"n_shapes": 80, "n_classes": 9})
    part = record("gps", gallery="tosca held out", data={"name": "tosca", "title": "tosca"})
    report(tmp_path, artefacts, whole, part)
    assert "80</td>" in (tmp_path / "index.html").read_text()


def test_names_that_are_no_names_of_files_are_none_here_either(artefacts, tmp_path):
    data = {"name": HOSTILE, "title": HOSTILE, "source": HOSTILE}
    report(
        tmp_path,
        artefacts,
        record(HOSTILE, gallery=HOSTILE, title=HOSTILE, family=HOSTILE, data=data, labels=[HOSTILE] * 2 + ["b"] * 2),
    )
    for path in tmp_path.rglob("*"):
        assert re.fullmatch(r"[\w.-]+", path.name)
        if path.suffix == ".html":
            assert "<script>alert" not in path.read_text()


def test_a_second_report_removes_what_the_first_wrote_and_nothing_else(artefacts, tmp_path):
    report(tmp_path, artefacts, record("gps"), record("gps", gallery="other"))
    (tmp_path / "mine.html").write_text("mine")
    outside = tmp_path.parent / "outside.txt"
    outside.write_text("kept")
    digest = hashlib.sha256(b"kept").hexdigest()
    listed = json.loads((tmp_path / CONTENTS).read_text())
    write_text(tmp_path / CONTENTS, json.dumps(listed | {"../outside.txt": [digest], "7": 7}))
    report(tmp_path, artefacts, record("gps"))
    assert {path.name for path in tmp_path.glob("*.html")} == {
        "index.html", "mine.html", "table-rods.html", "table-rods-forms.html",
    }  # fmt: skip
    assert outside.read_text() == "kept"


# Large and damaged ----------------------------------------------------------------------------------------------------


def test_damaged_distances_cost_their_job_alone(artefacts):
    folder = artefacts.store.artefacts / "ab"
    folder.mkdir(parents=True)
    (folder / "ab.npz").write_bytes(b"no archive")
    (cell,) = ranked_cells(contents([Result(record("gps"))])[0], artefacts)
    assert [gallery.ranking for gallery in cell.galleries] == [None]
    assert cell.precision() is None


def test_a_data_set_that_raises_costs_its_pictures_alone(artefacts, tmp_path):
    class Bad:
        name = "rods"
        half_width = None
        entries = tuple(Entry(name, name[:3], name[3:]) for name in SHAPES)

        def recipe(self, entry):
            raise ZeroDivisionError

        camera = recipe

    artefacts._datasets["rods"] = Bad()
    mesh, shape = record("identity"), Entry("cat0", "cat", "0")
    assert artefacts.surface(mesh, shape) is None
    assert isinstance(artefacts.form(mesh, shape), str)
    assert artefacts.seen(mesh, shape, rod(0.1, 1.0)).shape == rod(0.1, 1.0).vertices.shape
    assert report(tmp_path, artefacts, mesh).n_forms == 0


def test_classes_and_the_front_are_those_of_the_records(artefacts):
    rows = [
        record("gps", per_query={name: [1, 1, 0, 1] for name in PRINTED}, cost={"seconds_per_shape": {"a": 1, "b": 1}}),
        record("fast-mds", nn=0.5, family="control", cost={"seconds_per_shape": {"a": 0.5}}),
        record("slow", nn=0.25, cost={"seconds_per_shape": {"a": 9.0}}),
    ]  # fmt: skip
    (table,) = contents([Result(each) for each in rows])
    data = chart_data(table, ranked_cells(table, artefacts))
    told = {row["method"]: row["inputs"]["mesh"] for row in data["rows"]}
    assert data["classes"] == ["cat", "dog"]
    assert told["gps"]["classes"]["NN"] == [1.0, 0.5]
    assert told["gps"]["seconds"] == 2.0
    assert data["fronts"]["mesh"]["NN"] == {"methods": ["gps"], "all": ["fast-mds", "gps"]}


def test_commands_can_be_pasted(artefacts, tmp_path):
    """They name plugins and folders, and no row that no command makes or whose plugin was not given."""
    rows = (record("gps"), record("theirs", family="external"), record("of-a-plugin"), record("gps", gallery="animals"))
    tables = contents([Result(row) for row in rows])
    options = ("--plugin", "my file.py", "--data-root", "/data")
    write_report(tables, artefacts, tmp_path, "python -m benchmark report", options=options)
    commands = re.findall(r"python -m benchmark (run .*)\n", (tmp_path / "index.html").read_text())
    ours = "-m gps --plugin &#x27;my file.py&#x27; --data-root /data"
    assert commands == [f"run -t III -d animals {ours}", f"run -d rods {ours}"]
    write_report(tables, replace(artefacts, known={}), tmp_path, "report", force=True)
    assert "benchmark run" not in (tmp_path / "index.html").read_text()

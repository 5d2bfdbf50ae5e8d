"""Kendall's tau between two scorers from made-up records, and tables by one of them."""

import json

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import as_text
from tests.records import record
from tests.verbs import call

ORDER = ("classic-mds", "fast-mds", "gps", "pca", "identity")


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "results" / "runs" / "records"
    folder.mkdir(parents=True)

    def put(method, nn, **more):
        found = record(method, nn=nn, **more)
        found["recipe"]["scorer"] = {"name": more.get("scorer", "cm-bof")}
        found["key"] = digest(found["recipe"])
        (folder / f"{found['key']}.json").write_text(as_text(found))

    by = {"scorer": "spherical-harmonics", "scorer_title": "Spherical harmonics"}
    for place, method in enumerate(ORDER):
        put(method, 0.9 - place / 10)
        put(method, 0.2 + place / 10, **by)
    put("shape-dna", 0.99, scorer="none")
    return tmp_path / "results"


def test_tau_is_that_of_the_records_and_descriptors_have_no_say(results):
    text = call("compare", "cm-bof", "spherical-harmonics", "--results", results)
    row = next(line for line in text.splitlines() if line.startswith("| rods"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    # NN in the opposite order: of 120 orders, two are as far from 0. All other measures are the same for all methods.
    assert cells[2:5] == ["mesh", "5", "-1.00 (0.0167)"]
    assert cells[5:] == ["--", "--", "--"]


def test_each_scorer_has_tables_of_its_own_and_descriptors_are_in_both(results, tmp_path):
    plain = call("tables", "--results", results)
    other = call("tables", "--results", results, "--scorer", "spherical-harmonics")
    assert "scored by" not in plain and "scored by Spherical harmonics" in other
    for text, figure in ((plain, "0.90"), (other, "0.20")):
        rows = {line.split("|")[1].strip(" †"): line for line in text.splitlines() if line.startswith("| ")}
        assert figure in rows["Classic-Mds"]
        assert "0.99" in rows["Shape-Dna"]
    for options in ([], ["--scorer", "spherical-harmonics"]):
        call("tables", "--results", results, *options, "-o", tmp_path / "t", "--format", "markdown")
    files = sorted(path.name for path in (tmp_path / "t").glob("table-*"))
    assert files == ["table-rods-spherical-harmonics.md", "table-rods.md"]
    rows = json.loads(call("tables", "--results", results, "--scorer", "spherical-harmonics", "--format", "json"))
    assert {row["scorer"] for row in rows} == {"spherical-harmonics"}
    assert len(rows) == len(ORDER) + 1


def test_scorers_without_common_methods_and_unknown_ones_are_refused(results):
    for path in (results / "runs" / "records").glob("*.json"):
        if "scorer_title" in path.read_text():
            path.unlink()
    for arguments, said in (
        (["compare", "cm-bof", "spherical-harmonics"], "no table has scores of three methods"),
        (["tables", "--scorer", "spherical-harmonic"], "did you mean spherical-harmonics"),
    ):
        assert said in str(CliRunner().invoke(cli, [*arguments, "--results", str(results)]).exception)

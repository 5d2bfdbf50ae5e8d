"""Forms that another program made are scored like those of a method."""

import json
import shutil

import pytest

from benchmark.pipeline.storage.store import Store
from tests.toy import rod, write_off, write_rods
from tests.verbs import call


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Rods, the same in another folder with two more and fewer vertices, and a results folder."""
    folder = tmp_path_factory.mktemp("run")
    rods = write_rods(folder / "rods", bends=(0.0, 0.8, 1.6))
    shutil.copytree(rods, folder / "forms")
    write_off(folder / "forms" / "thin1.off", rod(0.06, 0.8, rings=12, sides=6))
    return folder


def rows(folder):
    found = json.loads(call("tables", "-d", "rods", "--results", folder / "results", "--format", "json"))
    return {row["title"]: row for row in found}


def test_forms_are_a_row_and_are_scored_once(run):
    arguments = ("run", "-d", run / "rods", "--results", run / "results", "--forms", f"Mine={run / 'forms'}")
    assert "| Mine (external)" in call(*arguments)
    row = rows(run)["Mine"]
    assert (row["method"], row["status"], row["coverage"]) == ("external-mine", "ok", 1)
    assert "| Mine (external)" in call("tables", "-m", "external-mine", "--results", run / "results")
    with pytest.raises(AssertionError, match="create it with 'score --results' or 'run --forms'"):
        call("run", "-d", run / "rods", "-m", "external-mine")
    assert row["NN"] > 0.6
    before = [record["finished"] for record in Store.open(run / "results").records]
    call(*arguments)
    assert [record["finished"] for record in Store.open(run / "results").records] == before


def test_missing_and_damaged_forms_count_zero(run, tmp_path):
    forms = shutil.copytree(run / "forms", tmp_path / "forms")
    (forms / "thin0.off").unlink()
    (forms / "thin2.off").write_text("OFF 1")
    said = call("run", "-d", run / "rods", "--results", tmp_path / "results", "--forms", f"Mine={forms}")
    assert "2 unsupported (thin0, thin2)" in said
    (record,) = Store.open(tmp_path / "results").records
    assert record["per_query"]["NN"][record["shapes"].index("thin0")] == 0
    assert record["coverage"] == pytest.approx(4 / 6)


@pytest.mark.parametrize("more", [("-m", "gps"), ("--forms", "nothing")])
def test_what_does_not_fit_is_refused(run, more):
    with pytest.raises(AssertionError, match="--forms scores the meshes of a folder"):
        call("run", "-d", run / "rods", "--forms", f"Mine={run / 'forms'}", *more)


def test_forms_that_take_too_long_are_stopped(run, tmp_path):
    with pytest.raises(AssertionError, match="scoring Mine does not end: stopped after 0.01 s.* raise --timeout"):
        call(
            "run", "-d", run / "rods", "--results", tmp_path, "--forms", f"Mine={run / 'forms'}", "--timeout", "0.01s"
        )  # fmt: skip


def test_a_folder_without_these_shapes_is_refused(run, tmp_path):
    with pytest.raises(AssertionError, match="name them like the shapes: thick0.off"):
        call("run", "-d", run / "rods", "--results", tmp_path, "--forms", f"Mine={tmp_path}")

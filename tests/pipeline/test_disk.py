"""A disk that is full, and a results folder that cannot be used: one line with the hint, and nothing half written."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from benchmark.cli import run as run_module
from benchmark.cli.main import cli
from benchmark.pipeline.storage.records import Records
from benchmark.pipeline.storage.store import StorageError, Store
from tests.records import record
from tests.toy import files_of_at_most

pytestmark = pytest.mark.usefixtures("forked_workers")


def run(rods, results, *more):
    selection = ("-d", str(rods), "-m", "surface-area", "--input", "mesh", "-j", "0")
    return CliRunner().invoke(cli, ["run", *selection, "--results", str(results), *more])


def test_what_could_not_be_saved_is_run_again_without_being_asked(rods, tmp_path):
    with files_of_at_most(8192):  # more than a record takes, less than a mesh
        done = run(rods, tmp_path)
    assert done.exit_code == 1
    assert "free some space or choose another --results DIR; finished jobs are kept" in done.output
    (found,) = Store.open(tmp_path).records
    assert found["status"] == "unsaved"
    assert list(tmp_path.rglob("*.tmp")) == []
    again = run(rods, tmp_path)
    assert "1 of 1 jobs to run" in again.output
    assert again.exit_code == 0
    (found,) = Store.open(tmp_path).records
    assert found["status"] == "ok"


def test_a_disk_without_room_for_a_record_ends_the_run_and_keeps_what_is_finished(rods, tmp_path):
    store = Store.open(tmp_path)
    store.write_record(record("gps"))
    with files_of_at_most(64):
        done = run(rods, tmp_path)
    assert isinstance(done.exception, StorageError)
    assert "free some space" in str(done.exception)
    assert list(store.records) == [record("gps")]
    assert list(tmp_path.rglob("*.tmp")) == []
    for path in store.records.folder.iterdir():
        json.loads(path.read_text())


@pytest.mark.parametrize("place", ["", "runs", "runs/records", "runs/artefacts"])
@pytest.mark.parametrize("verb", ["plan", "run", "tables"])
def test_a_file_in_the_place_of_a_folder_is_named_before_work_begins(rods, tmp_path, verb, place):
    blocked = tmp_path / "results" / place
    blocked.parent.mkdir(parents=True, exist_ok=True)
    blocked.write_text("mine")
    options = ("-j", "0") if verb == "run" else ()
    done = CliRunner().invoke(cli, [verb, "-d", str(rods), *options, "--results", str(tmp_path / "results")])
    assert isinstance(done.exception, StorageError)
    assert str(done.exception).startswith(f"cannot write to {tmp_path / 'results'}: ")
    assert str(done.exception).endswith("choose another --results DIR")
    assert blocked.read_text() == "mine"


def test_a_folder_in_the_place_of_a_record_is_named_before_work_begins(rods, tmp_path):
    first = run(rods, tmp_path)
    assert first.exit_code == 0
    (path,) = (tmp_path / "runs" / "records").iterdir()
    path.unlink()
    path.mkdir()
    done = run(rods, tmp_path)
    assert isinstance(done.exception, StorageError)
    assert path.name in str(done.exception)


def test_a_results_folder_that_vanishes_during_the_run_is_told(rods, tmp_path, monkeypatch):
    real = run_module.make_pool

    def vanishing(*arguments):
        shutil.rmtree(tmp_path / "runs")
        (tmp_path / "runs").write_text("something else")
        return real(*arguments)

    monkeypatch.setattr(run_module, "make_pool", vanishing)
    done = run(rods, tmp_path)
    assert isinstance(done.exception, StorageError)
    assert "choose another --results DIR" in str(done.exception)


def test_processes_whose_folder_vanished_end_the_run_with_its_name(rods, tmp_path, monkeypatch):
    real = run_module.make_pool

    def vanishing(*arguments):
        monkeypatch.setattr(Store, "open", classmethod(lambda cls, results: cls(results / "runs")))
        pool = real(*arguments)
        shutil.rmtree(tmp_path / "runs" / "progress")
        (tmp_path / "runs" / "progress").write_text("something else")
        return pool

    monkeypatch.setattr(run_module, "make_pool", vanishing)
    done = run(rods, tmp_path, "-j", "1")
    assert isinstance(done.exception, StorageError)
    assert "vanished during the run; restore it or choose another --results DIR" in str(done.exception)


def test_what_a_killed_merge_left_is_swept_by_the_next_run(rods, tmp_path):
    published = Records(tmp_path / "records")
    published.write(record("gps"))
    left = [published.folder / ".99999999-ab.tmp", tmp_path / "runs" / "records" / ".99999999-cd.tmp"]
    Store.open(tmp_path)
    for path in left:
        path.write_text("half")
    assert run(rods, tmp_path).exit_code == 0
    assert [path for path in left if path.exists()] == []

"""Records of several machines in one folder, and those that travel with the suite."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.pipeline.storage.merging import merge_records, publish
from benchmark.pipeline.storage.records import Records
from tests.pipeline.test_records import put_aliens
from tests.records import failed, record

LATER = "2026-02-01T00:00:00+00:00"


@pytest.fixture
def target(tmp_path):
    return Records(tmp_path / "target")


def test_new_records_are_added_and_known_ones_counted(target):
    target.write(record("fast-mds"))
    merged = merge_records([record("fast-mds", finished=LATER, peak_mib=1), record("gps")], target)
    assert ([r["method"] for r in merged.added], merged.known, merged.conflicts) == (["gps"], 1, [])
    assert target.read(record("fast-mds")["key"]) == record("fast-mds")


def test_one_key_with_two_outcomes_is_a_conflict_and_the_folder_keeps_what_it_has(target):
    target.write(record(nn=0.5))
    merged = merge_records([record(nn=0.75)], target)
    assert [(a["scores"]["NN"], b["scores"]["NN"]) for a, b in merged.conflicts] == [(0.5, 0.75)]
    assert list(target) == [record(nn=0.5)]


def test_a_failure_gives_way_to_a_result_and_never_the_other_way_round(target):
    target.write(failed())
    assert len(merge_records([record()], target).added) == 1
    merged = merge_records([failed()], target)
    assert (merged.added, merged.known) == ([], 1)
    assert list(target) == [record()]


def test_the_newest_record_of_a_place_is_published_alone(target):
    merged = publish([record(code="1", nn=0.5), record(code="2", nn=0.75, finished=LATER)], target)
    assert [r["scores"]["NN"] for r in merged.added] == [0.75]
    assert [r["scores"]["NN"] for r in target] == [0.75]
    assert "artefacts" not in next(iter(target))
    again = publish([record(code="2", nn=0.75, finished=LATER)], target)
    assert (again.added, again.known) == ([], 1)


def test_a_newer_record_takes_the_place_of_a_published_one_and_an_older_does_not(target):
    old, new = record(code="1", nn=0.5), record(code="2", nn=0.75, finished=LATER)
    publish([old], target)
    publish([new], target)
    assert [r["key"] for r in target] == [new["key"]]
    publish([old], target)
    assert [r["key"] for r in target] == [new["key"]]


@pytest.mark.parametrize("status", ["timeout", "failed", "killed"])
def test_what_has_no_scores_never_takes_the_place_of_what_has(target, status):
    publish([record(code="1")], target)
    publish([failed(status, code="2", finished=LATER)], target)
    assert [r["status"] for r in target] == ["ok"]
    publish([failed(status, method="gps")], target)  # where there is nothing, it says why
    assert sorted(r["status"] for r in target) == sorted(["ok", status])
    publish([record("gps", finished="2025-01-01T00:00:00+00:00")], target)
    assert [r["status"] for r in target] == ["ok", "ok"]


@pytest.mark.parametrize(
    "private",
    [
        record(data={"quick": True}),
        record(data={"source": "/home/me/rods"}),
        record(target=""),
        failed("unavailable"),
    ],
    ids=["quick run", "folder of one's own", "plugin file", "missing model"],
)
def test_what_means_nothing_to_others_is_not_published(target, private):
    assert publish([private], target).added == []
    assert list(target) == []


def test_the_verb_joins_folders_and_shows_conflicts(tmp_path):
    for name, nn in ("a", 0.5), ("b", 0.75):
        Records(tmp_path / name / "runs" / "records").write(record(nn=nn))
        Records(tmp_path / name / "runs" / "records").write(record(f"of-{name}"))
        put_aliens(tmp_path / name / "runs" / "records")
    folders = [str(tmp_path / name) for name in ("a", "b")]
    done = CliRunner().invoke(cli, ["merge", *folders, "--results", str(tmp_path / "all")])
    assert done.exit_code == 1
    assert "3 records added, 0 known, 1 conflicts" in done.output
    key = record()["key"][:12]
    assert f"conflict: rods mesh classic-mds ({key}): NN 0.500 FT 0.500" in done.output
    assert "here, NN 0.750" in done.output
    again = CliRunner().invoke(cli, ["merge", folders[0], "--results", str(tmp_path / "all")])
    assert (again.exit_code, again.stdout) == (0, "0 records added, 2 known, 0 conflicts\n")


TERMINATED = """
import os, signal, sys
from benchmark.cli.main import program

os.fsync = lambda file: os.kill(os.getpid(), signal.{name})
sys.argv[1:] = ["merge", "a", "--results", "all"]
program()
"""


def test_a_merge_that_is_killed_or_terminated_says_so_and_another_one_clears_up(tmp_path):
    Records(tmp_path / "a" / "runs" / "records").write(record())
    there = tmp_path / "all" / "runs" / "records"

    def ended_by(name):
        return subprocess.run(
            [sys.executable, "-c", TERMINATED.format(name=name)], cwd=tmp_path, capture_output=True, text=True,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}, check=False,
        )  # fmt: skip

    done = ended_by("SIGTERM")
    assert done.returncode == 143
    assert done.stderr == "terminated; added records are kept: merge again to finish\n"
    assert list(there.iterdir()) == []
    assert ended_by("SIGKILL").returncode == -9
    assert [path.suffix for path in there.iterdir()] == [".tmp"]
    again = CliRunner().invoke(cli, ["merge", str(tmp_path / "a"), "--results", str(tmp_path / "all")])
    assert again.stdout == "1 records added, 0 known, 0 conflicts\n"
    assert sorted(path.name for path in there.iterdir()) == ["parts", "rods.jsonl"]
    assert [each["key"] for each in Records(there)] == [record()["key"]]

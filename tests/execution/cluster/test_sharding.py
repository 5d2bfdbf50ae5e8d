"""Shards of a plan: nothing is lost or done twice, and what they leave is joined to what one run leaves."""

import json
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.execution.sharding import Shard
from benchmark.pipeline.storage.records import outcome
from benchmark.pipeline.storage.store import Store
from tests.toy import write_rods
from tests.verbs import call

#: Enough for every shard to have some; the last one has no model, and takes no mesh.
METHODS = ("surface-area", "shape-dna", "sd-gdm", "wks-mean", "learned[training_seed=7]")


def job(key, size, name="", state="missing"):
    return SimpleNamespace(key=key, name=name, state=state, identifiers=range(size))


@given(st.lists(st.tuples(st.integers(0, 30), st.sampled_from([5, 80, 400]))), st.integers(1, 7))
def test_every_job_is_in_exactly_one_shard_and_the_shards_are_even(described, count):
    jobs = [job(f"{number:02}", size) for number, size in dict(described).items()]
    cut = [Shard(number + 1, count).of(jobs) for number in range(count)]
    assert sorted(j.key for part in cut for j in part) == sorted(j.key for j in jobs)
    loads = [sum(len(j.identifiers) for j in part) for part in cut]
    assert max(loads) - min(loads) <= max((len(j.identifiers) for j in jobs), default=0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0/3", "there is no shard 0/3; write i/n"),
        ("4/3", "there is no shard 4/3; write i/n"),
        ("1/0", "there is no shard 1/0; write i/n"),
        ("a/b", "'a/b' is not a shard; write i/n"),
        ("-1/3", "'-1/3' is not a shard; write i/n"),
        ("1/2/3", "'1/2/3' is not a shard; write i/n"),
        ("²/3", "'²/3' is not a shard; write i/n"),
        ("", "'' is not a shard; write i/n"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "plan"])
def test_a_bad_shard_is_told_in_one_line_before_anything_runs(text, said, verb, tmp_path):
    done = CliRunner().invoke(cli, [verb, "--all", "--shard", text, "--results", str(tmp_path / "results")])
    assert isinstance(done.exception, ConfigurationError)
    assert str(done.exception).startswith(said)
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
def test_three_shards_and_merge_are_one_run(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    chosen = ("-d", rods, *(word for name in METHODS for word in ("-m", name)))
    # One method has no model for these shapes.
    whole = call("run", *chosen, "--executor", "serial", "--results", tmp_path / "whole", code=1)
    codes = []
    for number in (1, 2, 3):
        part = ("--shard", f"{number}/3", "--executor", "serial", "--results", tmp_path / f"part{number}")
        done = CliRunner().invoke(cli, [*map(str, ("run", *chosen, *part))])
        codes.append(done.exit_code)
        told, first, *_ = done.output.splitlines()
        assert told.startswith(f"shard {number}/3 of plan "), done.output
        assert 0 < int(first.split()[0]) < int(whole.split()[0])
    assert 1 in codes
    parts = [tmp_path / f"part{number}" for number in (1, 2, 3)]
    keys = [{record["key"] for record in Store.open(part).records} for part in parts]
    assert sum(map(len, keys)) == len(set.union(*keys))  # nothing is done twice
    (tmp_path / "part4" / "runs" / "records").mkdir(parents=True)  # a shard without jobs
    assert "0 known, 0 conflicts" in call("merge", *parts, tmp_path / "part4", "--results", tmp_path / "joined")

    def outcomes(folder):
        return {record["key"]: outcome(record) for record in Store.open(folder).records}

    assert outcomes(tmp_path / "joined") == outcomes(tmp_path / "whole")
    for folder in ("joined", "whole"):
        call("tables", *chosen, "--results", tmp_path / folder, "-o", tmp_path / f"tables-{folder}")
    for made in sorted((tmp_path / "tables-whole").iterdir()):
        if made.suffix in (".md", ".tex"):
            assert (tmp_path / "tables-joined" / made.name).read_bytes() == made.read_bytes()
    costs = {"seconds": None, "peak_mib": None}
    rows = [
        [row | costs for row in json.loads(call("tables", *chosen, "--format", "json", "--results", tmp_path / folder))]
        for folder in ("joined", "whole")
    ]
    assert rows[0] == rows[1]
    assert {record["status"] for record in Store.open(tmp_path / "joined").records} == {"ok", "unavailable"}

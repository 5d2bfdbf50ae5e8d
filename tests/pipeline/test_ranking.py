"""Ranking a gallery: one matrix at a time, and a word on how far it is."""

from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.pipeline import method_run
from benchmark.pipeline.storage import lock
from benchmark.pipeline.storage.store import Store
from tests.toy import write_rods


def test_a_job_whose_measures_alone_changed_ranks_again_and_renders_nothing(tmp_path, monkeypatch):
    rods, results = write_rods(tmp_path / "rods", bends=(0.0, 1.2)), tmp_path / "results"
    words = ["-d", str(rods), "-m", "identity", "--input", "mesh", "--results", str(results), "--executor", "serial"]
    assert CliRunner().invoke(cli, ["run", *words]).exit_code == 0
    (before,) = Store.open(results).records

    real = lock.read_lock()
    measures = real.components["measures"]._replace(golden="0123")
    other = real._replace(components={**real.components, "measures": measures})
    monkeypatch.setattr(lock, "read_lock", cache(lambda: other))
    monkeypatch.setattr(method_run, "signature_of", lambda *_: pytest.fail("a form was rendered"))
    assert "versions changed: measures" in CliRunner().invoke(cli, ["plan", *words[:-2]]).output
    done = CliRunner().invoke(cli, ["run", *words])
    assert done.exit_code == 0, done.output
    (after,) = [record for record in Store.open(results).records if record["key"] != before["key"]]
    for part in ("scores", "per_query", "digests", "environments", "artefacts"):
        assert after[part] == before[part], part
    assert after["cost"]["seconds_per_shape"].keys() == before["cost"]["seconds_per_shape"].keys()


def test_distances_that_are_damaged_are_made_again(tmp_path, monkeypatch):
    rods, results = write_rods(tmp_path / "rods", bends=(0.0, 1.2)), tmp_path / "results"
    words = ["-d", str(rods), "-m", "identity", "--input", "mesh", "--results", str(results), "--executor", "serial"]
    assert CliRunner().invoke(cli, ["run", *words]).exit_code == 0
    store = Store.open(results)
    (before,) = store.records
    for key in before["artefacts"]:
        if "distances" in dict(np.load(results / "runs" / "artefacts" / key[:2] / f"{key}.npz")):
            store.discard(key)
    store.remove_record(before["key"])
    # Their headers may be whole where they are not: nothing is known of them before they are read.
    monkeypatch.setattr(Store, "digest_under", lambda self, key: "kept")
    done = CliRunner().invoke(cli, ["run", *words])
    assert done.exit_code == 0, done.output
    (after,) = store.records
    assert after["per_query"] == before["per_query"]

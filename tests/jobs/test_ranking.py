"""Ranking a gallery: one matrix at a time, and a word on how far it is."""

import weakref
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.jobs import method_run
from benchmark.jobs.execution import runner
from benchmark.jobs.job_specs import ScoringTask, ShapeBatch
from benchmark.jobs.plan import make_plan
from benchmark.jobs.stages.measures import over_splits, scores
from benchmark.plugins.registry import methods, select
from benchmark.protocols.galleries import galleries
from benchmark.storage import lock
from benchmark.storage.store import Store
from retrieval import codebook
from retrieval.codebook import sample_codebook
from tests.toy import write_rods

LABELS = ["cat", "cat", "dog", "dog", "elk", "elk"]


def matrices(count, alive):
    """Matrices of a gallery, made when asked for; notes how many of those before are still held."""

    def made(seed):
        found = np.random.default_rng(seed).random((len(LABELS), len(LABELS)))
        found += found.T
        known.append(weakref.ref(found))
        return found

    known = []
    for seed in range(count):
        alive.append(sum(each() is not None for each in known))
        yield made(seed)


@pytest.mark.parametrize("judge", [scores, lambda found, labels: over_splits(found, labels, 2)])
def test_a_matrix_is_forgotten_before_the_next_one_is_made(judge):
    alive = []
    judge(matrices(3, alive), LABELS)
    assert alive == [0, 0, 0]


def test_words_do_not_depend_on_how_many_descriptors_are_looked_at_together(monkeypatch):
    rng = np.random.default_rng(0)
    parts = [rng.integers(0, 3, (rng.integers(0, 90), 128)).astype(np.uint8) for _ in range(20)]
    parts += [part[::2] for part in parts]
    whole = sample_codebook(parts, 100, seed=1)
    for pool in (1, 70, 500):
        monkeypatch.setattr(codebook, "POOL", pool)
        np.testing.assert_array_equal(sample_codebook(parts, 100, seed=1), whole)


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


@pytest.mark.slow
def test_ranking_tells_which_draw_is_under_way(tmp_path):
    store = Store.open(tmp_path / "results")
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    specs = select(("identity",), methods())
    (job,) = make_plan(galleries((), [str(rods)]), ["mesh"], specs, store)
    told = []
    runner.work(ShapeBatch((job,), job.identifiers), lambda *_: None)
    runner.work(ScoringTask((job,)), lambda key, steps, shape="": told.append((key, shape)))
    record = store.records.read(job.key)
    assert record["status"] == "ok"
    said = [shape for key, shape in told if key == job.key]
    assert said == ["", *(f"comparing 4 forms, {n} of 3" for n in (1, 2, 3))]

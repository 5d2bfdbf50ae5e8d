"""Ranking a gallery: whole or block by block, and not again what was ranked before."""

from functools import cache

import numpy as np
import pytest

from benchmark.execution import job_specs
from benchmark.execution.job_specs import Task, comparison_tasks, first_tasks
from benchmark.execution.plan import make_plan
from benchmark.execution.runner import work
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline import method_run, ranking
from benchmark.pipeline.storage import lock
from benchmark.pipeline.storage.records import outcome
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, select
from benchmark.plugins.scorers import scorer_of, scorers
from benchmark.protocols.galleries import galleries
from tests.toy import rod, write_off, write_rods
from tests.verbs import call


@pytest.fixture
def ran(tmp_path):
    """Words by which a method was run on rods, the store, and the record."""
    rods, results = write_rods(tmp_path / "rods", bends=(0.0, 1.2)), tmp_path / "results"
    words = ("-d", rods, "-m", "identity", "--input", "mesh", "--results", results)
    call("run", *words, "-j", "0")
    store = Store.open(results)
    (before,) = store.records
    return words, store, before


def test_a_job_whose_measures_alone_changed_ranks_again_and_renders_nothing(ran, monkeypatch):
    words, store, before = ran
    real = lock.read_lock()
    measures = real.components["measures"]._replace(golden="0123")
    other = real._replace(components={**real.components, "measures": measures})
    monkeypatch.setattr(lock, "read_lock", cache(lambda: other))
    monkeypatch.setattr(method_run, "signature_of", lambda *_: pytest.fail("a form was rendered"))
    assert "versions changed: measures" in call("plan", *words)
    call("run", *words, "-j", "0")
    (after,) = [record for record in store.records if record["key"] != before["key"]]
    for part in ("scores", "per_query", "digests", "environments", "artefacts"):
        assert after[part] == before[part], part
    assert after["cost"]["seconds_per_shape"].keys() == before["cost"]["seconds_per_shape"].keys()


def test_distances_that_are_damaged_are_made_again(ran, monkeypatch):
    words, store, before = ran
    for key in before["artefacts"]:
        if "distances" in dict(np.load(store.artefacts / key[:2] / f"{key}.npz")):
            store.discard(key)
    store.remove_record(before["key"])
    # Their headers may be whole where they are not: nothing is known of them before they are read.
    monkeypatch.setattr(Store, "digest_under", lambda self, key: "kept")
    call("run", *words, "-j", "0")
    (after,) = store.records
    assert after["per_query"] == before["per_query"]


@pytest.fixture
def plan(tmp_path):
    """Return the plan of one method on rods, of which one cannot be treated."""
    rods = write_rods(tmp_path / "rods", bends=(0.0, 0.6, 1.2))
    write_off(rods / "thin9.off", Mesh(rod(0.1, 0.7).vertices * 0, rod(0.1, 0.7).faces))

    def jobs(results, method="identity", scorer="cm-bof"):
        chosen = galleries((), [str(rods)], None)
        chosen_scorer = scorer_of(scorer, scorers())
        store = Store.open(tmp_path / results)
        return make_plan(chosen, ["mesh"], select((method,), methods()), store, scorer=chosen_scorer)

    return jobs


def ranked(job, *, apart=False):
    """Do the tasks of a job; returns its record."""
    for task in [*first_tasks([job]), *(comparison_tasks(job) if apart else ()), Task((job,))]:
        work(task, lambda *_: None)
    return Store.open(job.results).records.read(job.key)


@pytest.mark.parametrize(
    ("method", "scorer"),
    [
        ("identity", "cm-bof"),
        ("identity", "cm-bof[allow_mirror=true]"),
        ("surface-area", "cm-bof"),
    ],
)
def test_a_gallery_that_is_ranked_block_by_block_has_the_same_record(plan, tmp_path, monkeypatch, method, scorer):
    (job,) = plan("whole", method, scorer)
    whole = ranked(job)
    monkeypatch.setattr(ranking, "BLOCK", 4)
    monkeypatch.setattr(job_specs, "BLOCK", 4)
    (job,) = plan("blocks", method, scorer)
    assert len(comparison_tasks(job)) == (1 if method == "surface-area" else 2 * job.scorer.info.draws)
    blocks = ranked(job, apart=True)
    assert whole["status"] == "ok"
    assert whole["unsupported"]
    assert outcome(blocks) == outcome(whole)
    for stage in ("shapes", "forms", "signatures"):
        assert blocks["digests"].get(stage) == whole["digests"].get(stage)
    matrices = [
        dict(ranking.matrices_of(record, Store.open(tmp_path / name)))
        for name, record in (("whole", whole), ("blocks", blocks))
    ]
    assert matrices[0].keys() == matrices[1].keys()
    assert all(np.array_equal(matrices[0][key], matrix) for key, matrix in matrices[1].items())


def test_blocks_that_were_compared_before_are_not_compared_again(plan, monkeypatch):
    monkeypatch.setattr(ranking, "BLOCK", 4)
    monkeypatch.setattr(job_specs, "BLOCK", 4)
    (job,) = plan("results")
    batch, *others = [*first_tasks([job]), *comparison_tasks(job)]
    for task in (batch, *others):
        work(task, lambda *_: None)
    monkeypatch.setattr(ranking.GalleryRanking, "_compared", lambda *_: pytest.fail("compared twice"))
    work(Task((job,)), lambda *_: None)
    store = Store.open(job.results)
    assert store.records.read(job.key)["status"] == "ok"
    store.drop_scratch()
    store.remove_record(job.key)
    monkeypatch.setattr(method_run, "signature_of", lambda *_: pytest.fail("a form was rendered"))
    work(Task((job,)), lambda *_: None)
    assert store.records.read(job.key)["status"] == "ok"


def test_a_gallery_whose_whole_matrices_are_kept_is_not_compared_in_blocks(plan, monkeypatch):
    (job,) = plan("results")
    whole = ranked(job)
    monkeypatch.setattr(ranking, "BLOCK", 4)
    monkeypatch.setattr(ranking.GalleryRanking, "_compared", lambda *_: pytest.fail("compared again"))
    Store.open(job.results).remove_record(job.key)
    assert ranked(job)["digests"] == whole["digests"]

"""What no record needs goes, and all else stays."""

import os

import numpy as np
import pytest

from benchmark.pipeline.storage.store import Store, sweep_leftovers, unneeded
from tests.records import failed, record
from tests.toy import write_rods
from tests.verbs import call

LATER = "2026-02-01T00:00:00+00:00"


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "results")


def artefact(store, name, **options):
    return store.get_or_compute({"name": name}, lambda: {"x": np.arange(1000)}, **options).key


def there(store):
    return {path.stem for path in store.artefact_files()}


def test_what_the_newest_record_of_each_place_was_made_from_stays(store):
    old, new, other, lost = (artefact(store, name) for name in ("old", "new", "other", "lost"))
    store.write_record(record(code="1", artefacts=[old, other]))
    store.write_record(record(code="2", artefacts=[new], finished=LATER))
    store.write_record(record("pca", artefacts=[other]))
    undone = {**record(artefacts=[], finished="2026-03-01T00:00:00+00:00"), "key": "deadbeef-" + "0" * 32}
    store.write_record(undone)
    assert {path.stem for path in unneeded(store)} == {old, lost}


def test_scratch_and_leftovers_of_the_dead_go_and_those_of_the_living_stay(store):
    features = artefact(store, "features", scratch=True)
    dead, living = 2**22 + 1, os.getpid()  # beyond the largest number of a process
    for folder in (store.artefacts / "ab", store.scratch / "ab", store.records.folder):
        folder.mkdir(parents=True, exist_ok=True)
        for process in (dead, living):
            (folder / f".{process}-00.tmp").write_text("half")
    for process in (dead, living):
        (store.progress / f"{process}-0").write_text("job;1;")
    names = sorted(path.name for path in unneeded(store))
    assert names == sorted([f"{features}.npz", *[f".{dead}-00.tmp"] * 3, f"{dead}-0"])
    sweep_leftovers(store)
    assert [path.name for path in store.progress.iterdir()] == [f"{living}-0"]
    assert sorted(path.name for path in unneeded(store)) == [f"{features}.npz"]


def test_the_verb_frees_what_it_announces_and_a_run_computes_nothing_again(tmp_path, store):
    """Descriptors alone, for they need no features: two methods, of which one is run by other code before."""
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    arguments = ("-d", rods, "--input", "mesh", "--results", tmp_path / "results")
    chosen = ("-m", "surface-area", "-m", "shape-dna")
    first = call("run", *arguments, *chosen, "--executor", "serial")
    assert "2 of 2 jobs to run" in first
    kept = there(store)
    stray = artefact(store, "stray")
    store.write_record(failed("crashed", method="surface-area", code="0", finished="2020-01-01T00:00:00+00:00"))
    size = next(path.stat().st_size for path in store.artefact_files() if path.stem == stray)
    assert call("prune", "--dry-run", "--results", tmp_path / "results") == (
        f"would free {size / 2**20:.1f} MiB in 1 files\n"
    )
    assert there(store) == {*kept, stray}
    assert call("prune", "--results", tmp_path / "results") == f"freed {size / 2**20:.1f} MiB in 1 files\n"
    assert there(store) == kept
    assert "0 of 2 jobs to run, 2 finished before" in call("run", *arguments, *chosen, "--executor", "serial")
    # Another method needs no more than its own artefacts: the shapes are still prepared.
    call("run", *arguments, "-m", "shape-dna[count=6]", "--executor", "serial")
    assert len(there(store) - kept) == 4 + 1

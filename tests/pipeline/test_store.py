import resource
import time

import numpy as np
import pytest

from benchmark.pipeline.storage.store import StorageError, Store


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path)


def test_a_recipe_is_computed_once_and_keeps_its_cost(store):
    calls = []

    def compute():
        calls.append(1)
        time.sleep(0.05)
        return {"x": np.arange(3)}

    first, second = (store.get_or_compute({"a": 1}, compute) for _ in range(2))
    assert len(calls) == 1
    assert not first.was_cached
    assert second.was_cached
    assert second.cost == first.cost
    assert second.cost.seconds >= 0.05
    np.testing.assert_array_equal(second.arrays["x"], [0, 1, 2])


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", None])
def test_a_damaged_artefact_is_made_again(store, damage):
    store.get_or_compute({"a": 1}, lambda: {"x": np.arange(1000)})
    (path,) = (store.root / "artefacts").rglob("*.npz")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] if damage is None else damage)
    again = store.get_or_compute({"a": 1}, lambda: {"x": np.arange(1000)})
    assert not again.was_cached
    assert store.find({"a": 1}) is not None


def test_a_full_disk_is_named_and_leaves_nothing_half_written(store):
    """A file size limit makes writing fail as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(StorageError, match="free some space"):
            store.get_or_compute({"a": 1}, lambda: {"x": np.zeros(10**6)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [path for path in (store.root / "artefacts").rglob("*") if path.is_file()] == []
    assert not store.get_or_compute({"a": 1}, lambda: {"x": np.zeros(10**6)}).was_cached


def test_a_results_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="choose another --results"):
        Store.open(tmp_path / "file")

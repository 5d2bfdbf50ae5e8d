"""Damage of an artefact, wherever it strikes, means that it is made again; and nothing wrong is ever read."""

import io
import zipfile

import numpy as np
import pytest

from benchmark import arrays as module
from benchmark.arrays import load_arrays, save_arrays
from benchmark.pipeline.storage.store import Store

KEY = "ab" * 16
ARRAYS = {"vertices": np.arange(12.0).reshape(4, 3), "faces": np.array([[0, 1, 2], [1, 2, 3]]), "note:n": np.array(3)}


def compute():
    return ARRAYS


def made(tmp_path, *, scratch):
    """A store with one artefact, and its file."""
    store = Store.open(tmp_path)
    store.get_or_compute({"a": 1}, compute, scratch=scratch)
    (path,) = tmp_path.rglob("*.npz")
    return store, path


def survives(store, path, content):
    """Whether a file with this content is made again, or read as what was kept."""
    path.write_bytes(content)
    artefact = store.find({"a": 1})
    if artefact is None:
        return True
    same = artefact.arrays.keys() == ARRAYS.keys()
    return same and all(
        artefact.arrays[name].dtype == array.dtype and np.array_equal(artefact.arrays[name], array)
        for name, array in ARRAYS.items()
    )


def flips(content, step, start=0):
    for position in range(start, 8 * len(content), step):
        changed = bytearray(content)
        changed[position // 8] ^= 1 << position % 8
        yield position, bytes(changed)


@pytest.mark.parametrize(
    ("step", "start"), [(61, 0), *(pytest.param(8, bit, marks=pytest.mark.exhaustive) for bit in range(8))]
)
@pytest.mark.parametrize("scratch", [False, True], ids=["compressed", "stored"])
def test_a_flipped_bit_is_noticed_or_harms_nothing(tmp_path, scratch, step, start):
    store, path = made(tmp_path, scratch=scratch)
    whole = path.read_bytes()
    wrong = [p for p, content in flips(whole, step, start) if not survives(store, path, content)]
    assert wrong == []
    path.write_bytes(whole)
    assert store.get_or_compute({"a": 1}, compute, scratch=scratch).was_cached


@pytest.mark.parametrize("scratch", [False, True], ids=["compressed", "stored"])
def test_every_length_of_a_truncated_file_is_noticed(tmp_path, scratch):
    store, path = made(tmp_path, scratch=scratch)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        assert store.find({"a": 1}) is None
    first, second = (store.get_or_compute({"a": 1}, compute, scratch=scratch) for _ in range(2))
    assert (first.was_cached, second.was_cached) == (False, True)
    assert second.cost == first.cost


def archive(parts):
    """A zip whose checksums are right, whatever its parts hold."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in parts.items():
            zipped.writestr(name, content)
    return file.getvalue()


def parts_of(path):
    with zipfile.ZipFile(path) as found:
        return {name: found.read(name) for name in found.namelist()}


def npy(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


@pytest.mark.parametrize(
    "change",
    [
        lambda parts: parts.pop("faces.npy"),
        lambda parts: parts.update({"more.npy": npy(np.arange(3))}),
        lambda parts: parts.update({"faces.npy": npy(np.arange(6))}),
        lambda parts: parts.update({"faces.npy": npy(ARRAYS["faces"].astype(np.int32))}),
        lambda parts: parts.update({"faces.npy": npy(ARRAYS["faces"]) + b"more"}),
        lambda parts: parts.update({"faces.npy": npy(ARRAYS["faces"])[:-8]}),
        lambda parts: parts.update({"faces.npy": parts["faces.npy"].replace(b"(2, 3)", b"(1, 3)")}),
        lambda parts: parts.update({"faces.npy": parts["faces.npy"].replace(b"(2, 3)", b"(9**9,)")}),
        lambda parts: parts.update({"faces.npy": npy(np.array([{"danger": 1}], dtype=object))}),
        lambda parts: parts.update({"__contents__.npy": npy(np.array("{"))}),
        lambda parts: parts.update({"__contents__.npy": npy(np.array("[" * 50_000))}),
        lambda parts: parts.update({"__cost__.npy": npy(np.array("[]"))}),
        lambda parts: parts.pop("__environment__.npy"),
        lambda parts: parts.pop("__contents__.npy"),
        dict.clear,
    ],
)
def test_what_is_whole_but_something_else_is_made_again(tmp_path, change):
    store, path = made(tmp_path, scratch=False)
    parts = parts_of(path)
    assert survives(store, path, archive(parts))
    assert store.find({"a": 1}) is not None
    change(parts)
    path.write_bytes(archive(parts))
    assert store.find({"a": 1}) is None


def test_the_artefact_of_another_recipe_under_this_name_is_made_again(tmp_path):
    store, path = made(tmp_path, scratch=False)
    other = store.get_or_compute({"a": 2}, lambda: {"vertices": np.zeros((4, 3))})
    path.write_bytes((store.artefacts / other.key[:2] / f"{other.key}.npz").read_bytes())
    assert store.find({"a": 1}) is None
    assert not store.get_or_compute({"a": 1}, compute).was_cached


def test_a_small_file_that_unfolds_to_more_than_memory_holds_is_not_unfolded(tmp_path, monkeypatch):
    store, path = made(tmp_path, scratch=False)
    path.write_bytes(archive(parts_of(path) | {"faces.npy": bytes(2**24)}))
    assert path.stat().st_size < 2**16
    opened = []
    real = zipfile.ZipFile.open
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda self, part: opened.append(part) or real(self, part))
    monkeypatch.setattr(module, "LARGEST", 2**20)
    assert store.find({"a": 1}) is None
    assert opened == []


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((0, 3)),
        np.array("a text"),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.array(True),
        np.arange(5, dtype=">i2"),
        np.array(["é\ud800", ""]),
    ],
    ids=["nothing", "text", "by column", "yes", "big-endian", "texts"],
)
@pytest.mark.parametrize("compressed", [True, False])
def test_arrays_come_back_as_they_were(tmp_path, array, compressed):
    loaded = kept(tmp_path / "file", array, compressed=compressed)
    assert (loaded.dtype, loaded.shape, loaded.strides) == (array.dtype, array.shape, array.strides)
    assert np.array_equal(loaded, array)
    assert loaded.flags.writeable


def kept(path, array, *, compressed=True):
    """What an array is after it was written to a file and read."""
    with path.open("wb") as file:
        save_arrays(file, KEY, {"x": array}, compressed=compressed)
    return load_arrays(path, KEY)["x"]


def symmetric(count, dtype=float):
    drawn = np.random.default_rng(count).random((count, count)).astype(dtype)
    return drawn + drawn.T


@pytest.mark.parametrize("count", [0, 1, 2, 255, 256, 257, 600])
@pytest.mark.parametrize("dtype", ["<f8", "<f4", ">f8", "<f2"])
def test_a_symmetric_matrix_comes_back_to_the_last_bit(tmp_path, count, dtype):
    matrix = symmetric(count, dtype)
    loaded = kept(tmp_path / "file", matrix)
    assert (loaded.dtype, loaded.shape, loaded.strides) == (matrix.dtype, matrix.shape, matrix.strides)
    assert loaded.tobytes() == matrix.tobytes()
    assert loaded.flags.writeable

"""Damage of an artefact, wherever it strikes, means that it is made again; and nothing wrong is ever read."""

import io
import json
import zipfile

import numpy as np
import pytest

from benchmark.storage.store import Store
from benchmark.system import arrays as module
from benchmark.system.arrays import load_arrays, save_arrays

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


def survives(store, path, content, *, scratch):
    """Whether a file with this content is made again, or read as what was kept."""
    path.write_bytes(content)
    found = store.find({"a": 1}, scratch=scratch)
    if found is None:
        return True
    same = found.arrays.keys() == ARRAYS.keys()
    return same and all(
        found.arrays[name].dtype == array.dtype and np.array_equal(found.arrays[name], array)
        for name, array in ARRAYS.items()
    )


def flips(content, step, start=0):
    for position in range(start, 8 * len(content), step):
        changed = bytearray(content)
        changed[position // 8] ^= 1 << position % 8
        yield position, bytes(changed)


@pytest.mark.parametrize("scratch", [False, True], ids=["compressed", "stored"])
def test_a_flipped_bit_here_and_there_is_noticed_or_harms_nothing(tmp_path, scratch):
    store, path = made(tmp_path, scratch=scratch)
    whole = path.read_bytes()
    wrong = [p for p, content in flips(whole, 61) if not survives(store, path, content, scratch=scratch)]
    assert wrong == []
    path.write_bytes(whole)
    assert store.get_or_compute({"a": 1}, compute, scratch=scratch).was_cached


@pytest.mark.exhaustive
@pytest.mark.parametrize("bit", range(8))
@pytest.mark.parametrize("scratch", [False, True], ids=["compressed", "stored"])
def test_every_flipped_bit_is_noticed_or_harms_nothing(tmp_path, scratch, bit):
    store, path = made(tmp_path, scratch=scratch)
    whole = path.read_bytes()
    wrong = [p for p, content in flips(whole, 8, bit) if not survives(store, path, content, scratch=scratch)]
    assert wrong == []


@pytest.mark.parametrize("scratch", [False, True], ids=["compressed", "stored"])
def test_every_length_of_a_truncated_file_is_noticed(tmp_path, scratch):
    store, path = made(tmp_path, scratch=scratch)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        assert store.find({"a": 1}, scratch=scratch) is None
    assert not store.get_or_compute({"a": 1}, compute, scratch=scratch).was_cached
    assert store.get_or_compute({"a": 1}, compute, scratch=scratch).was_cached


def archive(parts):
    """A zip whose checksums are right, whatever its parts hold."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as found:
        for name, content in parts.items():
            found.writestr(name, content)
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
    assert survives(store, path, archive(parts), scratch=False)
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
    with (tmp_path / "file").open("wb") as file:
        save_arrays(file, KEY, {"x": array}, compressed=compressed)
    found = load_arrays(tmp_path / "file", KEY)["x"]
    assert (found.dtype, found.shape, found.strides) == (array.dtype, array.shape, array.strides)
    assert np.array_equal(found, array)
    assert found.flags.writeable


def kept(path, array, *, compressed=True):
    """What an array is after it was written to a file and read."""
    with path.open("wb") as file:
        save_arrays(file, KEY, {"x": array}, compressed=compressed)
    return load_arrays(path, KEY)["x"]


def symmetric(count, dtype=float):
    drawn = np.random.default_rng(count).random((count, count)).astype(dtype)
    return drawn + drawn.T


@pytest.mark.parametrize("name", ["allow_pickle", "file", "args", "self"])
def test_an_array_may_have_any_name(tmp_path, name):
    with (tmp_path / "file").open("wb") as file:
        save_arrays(file, KEY, {name: np.arange(3)}, compressed=True)
    assert load_arrays(tmp_path / "file", KEY)[name].tolist() == [0, 1, 2]


@pytest.mark.parametrize("count", [0, 1, 2, 255, 256, 257, 600])
@pytest.mark.parametrize("dtype", ["<f8", "<f4", ">f8", "<f2"])
def test_a_symmetric_matrix_comes_back_to_the_last_bit(tmp_path, count, dtype):
    matrix = symmetric(count, dtype)
    found = kept(tmp_path / "file", matrix)
    assert (found.dtype, found.shape, found.strides) == (matrix.dtype, matrix.shape, matrix.strides)
    assert found.tobytes() == matrix.tobytes()
    assert found.flags.writeable


def test_half_of_a_symmetric_matrix_is_kept_where_room_is_to_be_saved(tmp_path):
    path, matrix = tmp_path / "file", symmetric(400)
    kept(path, matrix)
    halved = path.stat().st_size
    uneven = matrix.copy()
    uneven[3, 300] += 1
    kept(path, uneven)
    assert 0.45 < halved / path.stat().st_size < 0.55
    kept(path, matrix, compressed=False)
    assert path.stat().st_size > matrix.nbytes


@pytest.mark.parametrize(
    ("place", "values"),
    [((2, 299), (1.0, np.nextafter(1.0, 2.0))), ((299, 2), (0.0, -0.0)), ((299, 298), (np.nan, 1.0))],
    ids=["the last bit", "the sign of a zero", "a NaN"],
)
def test_a_matrix_that_is_not_quite_symmetric_is_kept_whole(tmp_path, place, values):
    matrix = symmetric(300)
    matrix[place], matrix[place[::-1]] = values
    assert kept(tmp_path / "file", matrix).tobytes() == matrix.tobytes()


def test_a_symmetric_matrix_with_nan_comes_back(tmp_path):
    matrix = symmetric(5)
    matrix[1, 3] = matrix[3, 1] = matrix[2, 2] = np.nan
    assert kept(tmp_path / "file", matrix).tobytes() == matrix.tobytes()


@pytest.mark.parametrize(
    "kind",
    [
        ["<f8", [5, 5], "upper triangle"],
        ["<f8", [4, 5], "upper triangle"],
        ["<f8", [4], "upper triangle"],
        ["<f8", [], "upper triangle"],
        ["<f8", [-5, -5], "upper triangle"],
        ["<f8", [4.0, 4.0], "upper triangle"],
        ["<f8", ["4", "4"], "upper triangle"],
        ["<f4", [4, 4], "upper triangle"],
        ["<f8", [4, 4], "lower triangle"],
        ["<f8", [4, 4], "upper triangle", "upper triangle"],
        ["<f8", [4, 4]],
        ["<f8"],
        {},
    ],
    ids=str,
)
def test_a_half_that_is_not_what_the_file_says_of_it_is_refused(tmp_path, kind):
    path = tmp_path / "file"
    kept(path, symmetric(4))
    parts = parts_of(path)
    contents = {"key": KEY, "arrays": {"x": kind}}
    path.write_bytes(archive(parts | {"__contents__.npy": npy(np.array(json.dumps(contents)))}))
    with pytest.raises((ValueError, IndexError, TypeError)):
        load_arrays(path, KEY)


def test_a_half_that_unfolds_to_more_than_is_read_is_not_unfolded(tmp_path, monkeypatch):
    path, matrix = tmp_path / "file", symmetric(200)
    kept(path, matrix)
    monkeypatch.setattr(module, "LARGEST", matrix.nbytes * 3 // 4)  # the half would pass
    with pytest.raises(ValueError, match="too large once unfolded"):
        load_arrays(path, KEY)

"""Files of the cache: each damaged bit is found."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from hashlib import pbkdf2_hmac
from threading import Thread

import numpy as np
import pytest

from benchmark.pipeline.cache import Cache, UnreadableFile
from benchmark.pipeline.stages import SECONDS, timed

ARRAYS = {
    "descriptors": np.arange(24, dtype=np.uint8).reshape(2, 12),
    "offsets": np.arange(3),
    "seconds": np.array(2.5),
}


def test_a_file_with_any_flipped_bit_counts_as_missing_or_is_the_same(tmp_path):
    cache = Cache(tmp_path)
    cache.write("forms", "key", ARRAYS)
    path = next(tmp_path.rglob("*.npz"))
    content = path.read_bytes()
    for place in range(len(content)):
        path.write_bytes(
            content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :]
        )
        read = cache.read("forms", "key")
        assert read is None or (
            read.keys() == ARRAYS.keys()
            and all(np.array_equal(read[name], ARRAYS[name]) for name in read)
        )
    path.write_bytes(content)
    assert {*cache.read("forms", "key", without=["offsets"], only=["seconds", "offsets"])} == {
        "seconds"
    }
    path.write_bytes(content[:-30])
    assert cache.read("forms", "key") is cache.read("forms", "other") is None


def test_a_file_that_this_process_cannot_open_is_not_taken_for_damaged(tmp_path):
    cache = Cache(tmp_path)
    cache.write("forms", "key", ARRAYS)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        with pytest.raises(UnreadableFile, match=r"forms/key\.npz: Too many open files"):
            cache.read("forms", "key")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert cache.read("forms", "key") is not None


def test_a_file_for_which_there_is_no_memory_is_not_taken_for_damaged(tmp_path, monkeypatch):
    cache = Cache(tmp_path)
    cache.write("forms", "key", ARRAYS)

    def refuse(*_):
        raise MemoryError

    monkeypatch.setattr("benchmark.pipeline.cache._array_of", refuse)
    with pytest.raises(MemoryError):
        cache.read("forms", "key")
    with pytest.raises(MemoryError):
        cache.get("forms", "key", dict)
    monkeypatch.undo()
    assert cache.read("forms", "key").keys() == ARRAYS.keys()


def test_processor_time_is_that_of_threads_and_ended_children_without_what_a_step_waits():
    word = (b"", b"", 400_000)

    def in_thread():
        thread = Thread(target=pbkdf2_hmac, args=("sha256", *word))
        thread.start()
        thread.join()

    in_child = [sys.executable, "-c", f"import hashlib; hashlib.pbkdf2_hmac('sha256', *{word})"]
    waits, *works = (
        timed(lambda work=work: work() or {})[SECONDS]
        for work in (
            lambda: time.sleep(0.2),
            lambda: pbkdf2_hmac("sha256", *word) and {},
            in_thread,
            lambda: subprocess.run(in_child, check=True) and {},
        )
    )
    assert waits[1] < 0.1 < 0.2 <= waits[0]
    assert all(processor > 0.6 * works[0][1] > 0.01 for _, processor in works)

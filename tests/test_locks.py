"""Locks of files: refused, waited for, or not there."""

from __future__ import annotations

import errno
import fcntl
import threading
from pathlib import Path

import pytest

from benchmark.locks import take_lock


def test_a_lock_of_another_is_refused_with_the_given_error(tmp_path: Path) -> None:
    with (tmp_path / "lock").open("w") as theirs, (tmp_path / "lock").open("w") as ours:
        take_lock(theirs.fileno())
        with pytest.raises(ValueError, match="not now"):
            take_lock(ours.fileno(), refusal=ValueError("not now"))
        theirs.close()
        take_lock(ours.fileno(), refusal=ValueError("not now"))


def test_without_a_refusal_it_is_waited_for(tmp_path: Path) -> None:
    said = threading.Event()
    has_lock = threading.Event()

    def wait() -> None:
        with (tmp_path / "lock").open("w") as ours:
            take_lock(ours.fileno(), before_waiting=said.set)
            has_lock.set()

    with (tmp_path / "lock").open("w") as theirs:
        take_lock(theirs.fileno(), before_waiting=lambda: pytest.fail("nobody has it"))
        thread = threading.Thread(target=wait)
        thread.start()
        assert said.wait(60)
        assert not has_lock.is_set()
    thread.join(60)
    assert has_lock.is_set()


def test_a_file_system_without_locks_keeps_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(*_: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    with (tmp_path / "lock").open("w") as file:
        take_lock(file.fileno(), refusal=ValueError("not now"))

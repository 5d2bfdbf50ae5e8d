"""Files are whole or absent, and what killed writers leave is removed."""

import os
import subprocess
import sys

import pytest

from benchmark.files import sweep, write_atomically, write_text


def test_a_file_is_replaced_as_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "deep" / "file.txt"
    write_atomically(path, lambda file: file.write(b"old"), durable=True)

    def half(file):
        file.write(b"new, but only ha")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, half)
    assert path.read_text() == "old"
    assert [found.name for found in path.parent.iterdir()] == ["file.txt"]
    write_text(path, "new ünd whole")
    assert path.read_bytes() == "new ünd whole".encode()


def test_a_device_is_written_to_and_not_replaced(tmp_path):
    link = tmp_path / "nothing"
    link.symlink_to(os.devnull)
    write_text(link, "text")
    assert link.is_symlink()
    assert list(tmp_path.iterdir()) == [link]


def test_what_a_killed_writer_left_is_swept(tmp_path):
    command = (
        "import os, signal\nfrom pathlib import Path\nfrom benchmark.files import write_atomically\n"
        f"write_atomically(Path({str(tmp_path / 'a' / 'file')!r}), lambda f: os.kill(os.getpid(), signal.SIGKILL))"
    )
    assert subprocess.run([sys.executable, "-c", command], check=False).returncode == -9
    (dead,) = (tmp_path / "a").iterdir()
    others = ["999999-x.tmp", "file.tmp", "file"]
    for name in others:
        (tmp_path / "a" / name).write_text("")
    sweep(tmp_path)
    assert not dead.exists()
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(others)

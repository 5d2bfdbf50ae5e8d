"""Files are whole or absent, and what killed writers leave is removed."""

import contextlib
import errno
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import benchmark
from benchmark.datasets.folder import folder_set
from benchmark.datasets.mesh_files import read_mesh
from benchmark.depth.frame import FrameFiles
from benchmark.depth.intrinsics import Intrinsics, read_intrinsics
from benchmark.depth.reading import read_mask, read_values
from benchmark.errors import BenchmarkError
from benchmark.files import (
    _BYTE_ORDER_MARKS,
    decode,
    file_digest,
    names_in,
    read_file,
    sweep,
    write_atomically,
    write_text,
)
from benchmark.pipeline.record_files import read_files


def device(path):
    path.symlink_to("/dev/zero")


def endless(path):
    with path.open("wb") as file:
        file.truncate(2**42)


def by_system(path):
    path.symlink_to("/proc/self/mem")


def without_end(path):
    """A regular file that announces no bytes, and has no end."""
    path.symlink_to("/proc/self/pagemap")


def that_waits(path):
    path.symlink_to("/proc/kmsg")


def connection(path):
    with socket.socket(socket.AF_UNIX) as server, contextlib.chdir(path.parent):
        server.bind(path.name)


KINDS = (
    os.mkfifo,
    device,
    endless,
    by_system,
    without_end,
    that_waits,
    connection,
    Path.mkdir,
)
TRIANGLE = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def in_settings(path):
    (path.parent / "cat0.off").write_text(TRIANGLE)
    return folder_set(path.parent)


def beside_image(path):
    np.save(path.parent / "0.npy", np.ones((30, 40)))
    camera = Intrinsics(40, 40, 19.5, 14.5) if path.suffix == ".png" else None
    return FrameFiles(path.parent / "0.npy", camera).observe()


def beside_mesh(path):
    path.with_suffix(".vert").write_text("0 0 0\n" * 3)
    return read_mesh(path.with_suffix(".vert"))


def of_scene(path):
    accessor = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3"}
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 12, "uri": path.name}],
        "bufferViews": [{"buffer": 0, "byteLength": 12}],
        "accessors": [accessor],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
    }
    path.with_suffix(".gltf").write_text(json.dumps(scene))
    return read_mesh(path.with_suffix(".gltf"))


DOORS = {
    **dict.fromkeys(
        ("cat.off", "cat.obj", "cat.ply", "cat.off.gz", "cat.mat", "cat.stl", "cat.glb"), read_mesh
    ),
    "x.tri": beside_mesh,
    "x.bin": of_scene,
    "dataset.toml": in_settings,
    "x.cla": in_settings,
    **dict.fromkeys(
        ("d.txt", "d.npy", "d.npz", "d.mat", "d.matrix"),
        lambda path: benchmark.score(path, [*"aab"]),
    ),
    **dict.fromkeys(("l.txt", "l.cla"), lambda path: benchmark.score(np.ones((3, 3)), path)),
    **dict.fromkeys(("x.png", "x.pfm", "x.npy", "x.npz"), read_values),
    "x_mask.png": read_mask,
    "0_mask.png": beside_image,
    "camera.json": beside_image,
    "K.txt": read_intrinsics,
    "x": file_digest,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", DOORS)
def test_what_is_no_file_is_refused_by_its_name_at_once_at_every_door(tmp_path, name, kind):
    kind(tmp_path / name)
    with pytest.raises(BenchmarkError, match=name) as caught:
        DOORS[name](tmp_path / name)
    assert "\n" not in str(caught.value)


def test_the_advice_for_a_file_that_is_being_written_is_to_wait(tmp_path):
    without_end(tmp_path / "x.off")
    with pytest.raises(BenchmarkError, match=r"lies in /proc; wait until it is written, or copy"):
        read_mesh(tmp_path / "x.off")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_among_records_is_named_and_passed_over(tmp_path, capsys, kind):
    kind(tmp_path / "x.json")
    assert read_files([tmp_path / "x.json"]) == []
    assert f"skipped {tmp_path / 'x.json'}: " in capsys.readouterr().err


def test_a_file_of_the_largest_size_is_read_and_one_that_changes_is_not(tmp_path, monkeypatch):
    (tmp_path / "x").write_bytes(b"12345")
    assert read_file(tmp_path / "x", 5) == b"12345"
    with pytest.raises(OSError, match="more than 4 bytes"):
        read_file(tmp_path / "x", 4)
    monkeypatch.setattr(os, "fstat", lambda _: os.stat_result((0o100644, *range(5), 4, 0, 0, 0)))
    with pytest.raises(OSError, match="does not have the size"):
        read_file(tmp_path / "x", 5)


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


def raises(*arguments):
    """Return a writer whose disk fails, or whose library does."""

    def write(file):
        raise OSError(*arguments)

    return write


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((errno.ENOSPC, "No space left on device"), "[Errno 28] No space left on device: '{}'"),
        ((errno.EIO, "Input/output error", "of.tmp"), "[Errno 5] Input/output error: '{}'"),
        (("12 requested and 3 written",), "12 requested and 3 written"),
    ],
)
def test_an_error_names_the_file_that_is_not_written_and_keeps_its_reason(
    tmp_path, arguments, message
):
    path = tmp_path / "file"
    with pytest.raises(OSError, match=r"(?s).*") as caught:
        write_atomically(path, raises(*arguments))
    assert str(caught.value) == message.format(path)
    assert [*tmp_path.iterdir()] == []


def test_an_error_of_renaming_names_one_file(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError) as caught:
        write_text(tmp_path / "folder", "text")
    assert str(caught.value) == f"[Errno 21] Is a directory: '{tmp_path / 'folder'}'"


def test_a_device_is_written_to_and_not_replaced(tmp_path):
    link = tmp_path / "nothing"
    link.symlink_to(os.devnull)
    write_text(link, "text")
    assert link.is_symlink()
    assert list(tmp_path.iterdir()) == [link]


@pytest.mark.parametrize("mark", [*_BYTE_ORDER_MARKS])
def test_text_is_read_in_the_encoding_of_its_mark_which_a_damaged_byte_names(mark):
    encoding = _BYTE_ORDER_MARKS[mark]
    whole = mark + "né".encode(encoding)
    assert decode(whole) == "né"
    place = len(mark + "n".encode(encoding)) + 1
    with pytest.raises(UnicodeError, match=f"byte {place} is no text in {encoding}: it is binary"):
        decode(whole[:-1])


def test_what_a_killed_writer_left_is_swept(tmp_path):
    command = (
        "import os, signal\n"
        "from pathlib import Path\n"
        "from benchmark.files import write_atomically\n"
        "def die(file):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
        f"write_atomically(Path({str(tmp_path / 'a' / 'file')!r}), die)"
    )
    assert subprocess.run([sys.executable, "-c", command], check=False).returncode == -9
    (dead,) = (tmp_path / "a").iterdir()
    others = ["999999-x.tmp", "file.tmp", "file"]
    for name in others:
        (tmp_path / "a" / name).write_text("")
    sweep(tmp_path)
    assert not dead.exists()
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(others)


@pytest.mark.slow
def test_damaged_files_are_refused_by_name_or_read_alike_in_time_and_memory(tmp_path):
    command = [sys.executable, "-m", "tests.fuzz", "0", "5000", str(tmp_path / "found")]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"(?m)^ +\d+ \S* ?refused$", done.stdout)) > 12


def test_names_in_a_folder_have_one_order_on_every_file_system(tmp_path, monkeypatch):
    for name in ("b", "a", "c"):
        (tmp_path / name).touch()
    listed = [tmp_path / name for name in ("c", "a", "b")]
    monkeypatch.setattr(Path, "iterdir", lambda _: iter(listed))
    assert names_in(tmp_path) == ["a", "b", "c"]
    monkeypatch.undo()
    assert names_in(tmp_path / "none") == []

"""Every verb names at once what is no file, wherever it lies; none waits for it."""

import contextlib
import os
import signal
import socket

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from tests.toy import rod, write_off

#: Seconds after which a verb hangs; on any machine it needs a fraction of them.
LONGEST = 100


def without_end(path):
    """A regular file that announces no bytes, and has no end."""
    path.symlink_to("/proc/self/pagemap")


def by_system(path):
    path.symlink_to("/proc/self/maps")


def device(path):
    path.symlink_to("/dev/zero")


def connection(path):
    with socket.socket(socket.AF_UNIX) as server, contextlib.chdir(path.parent):
        server.bind(path.name)


KINDS = (os.mkfifo, device, without_end, by_system, connection)

#: What each verb is asked, and the file that is none.
VERBS = {
    "plan": ("plan", "-d", "set", "-m", "gps", "set/thin2.off"),
    "plan, scene": ("plan", "-d", "set", "-m", "gps", "set/thin2.gltf"),
    "plan, beside": ("plan", "-d", "set", "-m", "gps", "set/thin2.vert"),
    "plan, image": ("plan", "-d", "frames", "-m", "gps", "frames/thin2.png"),
    "plan, mask": ("plan", "-d", "frames", "-m", "gps", "frames/thin0_mask.png"),
    "plan, camera": ("plan", "-d", "frames", "-m", "gps", "frames/camera.json"),
    "data check": ("data", "check", "set", "set/thin2.off"),
    "data check, settings": ("data", "check", "set", "set/dataset.toml"),
    "data check, labels": ("data", "check", "set", "set/labels.csv"),
    "data export": ("data", "export", "set", "-o", "new", "set/thin2.off"),
    "plan, settings": ("plan", "-d", "set", "-m", "gps", "set/dataset.toml"),
    "run, labels": ("run", "-d", "set", "-m", "gps", "-j", "0", "set/labels.txt"),
    "canonicalise": ("canonicalise", "-m", "gps", "x.off", "-o", "form.off", "x.off"),
    "canonicalise, depth": ("canonicalise", "-m", "gps", "x.png", "-o", "form.off", "x.png"),
    "score": ("score", "x.txt", "--labels", "l.txt", "x.txt"),
    "score, labels": ("score", "d.txt", "--labels", "x.txt", "x.txt"),
    "score, packed": ("score", "d.txt", "--labels", "x.cla", "x.cla"),
    "check": ("check", "x.py", "x.py"),
    "tables": ("tables", "--published", "-t", "robustness", "-o", "pages", "pages/written.json"),
    "describe": ("describe", "gps", "--plugin", "x.py", "x.py"),
    "list": ("list", "methods", "--plugin", "x.py", "x.py"),
    "merge": ("merge", "other", "other/runs/records/x.json"),
}


#: Verbs that do not need the file: tables replace their list.
SILENT = (VERBS["tables"],)


@pytest.fixture
def never_waiting():
    """Fail where the test takes longer than anything but waiting does."""

    def late(*_):
        raise KeyboardInterrupt("it waits")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("asked", VERBS.values(), ids=VERBS)
def test_every_verb_ends_and_names_what_is_no_file(
    asked, kind, tmp_path, monkeypatch, never_waiting
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set").mkdir()
    for number, (name, size) in enumerate((("thin", 0.1), ("thick", 1.0)) * 2):
        write_off(tmp_path / "set" / f"{name}{number // 2}.off", rod(0.1, size + number / 10))
    (tmp_path / "frames").mkdir()
    for name in ("thin0", "thin1", "thick0", "thick1"):
        np.save(tmp_path / "frames" / f"{name}.npy", np.ones((30, 40)))
    np.savetxt(tmp_path / "d.txt", np.ones((3, 3)))
    (tmp_path / "l.txt").write_text("a\na\nb\n")
    *arguments, name = asked
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    kind(path)
    # What is skipped is said once a process and path.
    words = [str(tmp_path / word) if word == "other" else word for word in arguments]
    done = CliRunner().invoke(cli, words)
    said = f"{done.output} {done.exception}"
    is_named = path.name in said or "/proc/" in said  # a plugin is named by what it links to
    assert is_named or asked in SILENT, said

"""How the program ends: by an exit code that a script can tell, in one line, and with nothing left
behind.
"""

import os
import pty
import re
import subprocess
import sys
from contextlib import suppress

import pytest

from tests.behaviour.suite import call, environment, start
from tests.runs.toy import without_processes
from tests.toy import PATIENCE


@pytest.fixture(scope="module")
def scored(material, tmp_path_factory):
    """A folder with results of a descriptor; to be read only."""
    folder = tmp_path_factory.mktemp("scored")
    of_rods = ("-d", material / "rods", "-m", "surface-area", "-j", 0)
    with without_processes():
        assert call("run", *of_rods, "--results", folder / "results").code == 0
    return folder


def ended(process, timeout=PATIENCE):
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out or "", err or ""


def test_nobody_listens(scored):
    reads, writes = os.pipe()
    os.close(reads)
    process = start("tables", "-d", "rods", cwd=scored, stdout=writes)
    os.close(writes)
    assert ended(process) == (1, "", "")


def test_no_standard_streams_at_all(scored, tmp_path):
    command = (
        f"{sys.executable} -m benchmark tables --results {scored / 'results'} -d rods -o {tmp_path}"
    )
    shell = ["sh", "-c", f"exec {command} <&- >&- 2>&-"]
    assert subprocess.run(shell, env=environment(), timeout=PATIENCE, check=False).returncode == 0
    assert (tmp_path / "tables.json").is_file()


def test_a_working_folder_that_was_removed(scored, tmp_path):
    tables = f"{sys.executable} -m benchmark tables --results {scored / 'results'} -d rods"
    words = f"mkdir gone && cd gone && rmdir ../gone && {tables}"
    done = subprocess.run(
        ["sh", "-c", words],
        cwd=tmp_path,
        env=environment(),
        timeout=PATIENCE,
        check=False,
        capture_output=True,
        text=True,
    )
    problem = "error: the working folder was removed; go to one that exists\n"
    assert (done.returncode, done.stderr) == (2, problem)


def test_a_terminal_gets_the_same_figures(scored):
    main, other = pty.openpty()
    process = start("tables", "-d", "rods", "--input", "mesh", cwd=scored, stdout=other)
    os.close(other)
    shown = b""
    with suppress(OSError):
        while part := os.read(main, 4096):
            shown += part
    assert process.wait(60) == 0
    text = " ".join(re.sub(r"\x1b\[[0-9;]*m", "", shown.decode()).split())
    assert re.search(r"Surface area 1\.0+ ", text)
    assert "Random order .40 .40 .80 .71" in text


@pytest.mark.parametrize(
    "settings",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"PYTHONIOENCODING": "latin-1:strict"},
        {"LC_ALL": "C", "PYTHONUTF8": "0"},
    ],
    ids=str,
)
def test_a_terminal_that_lacks_a_character_ends_no_run(tmp_path, settings):
    """One process for the whole way from an argument to the terminal: there is no such method,
    which is said.
    """
    command = [
        sys.executable,
        "-m",
        "benchmark",
        "describe",
        "†-\udcff-ü\x1b[31m",
        "--results",
        os.fspath(tmp_path),
    ]
    done = subprocess.run(
        command, capture_output=True, env=os.environ | settings, check=False, timeout=PATIENCE
    )
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert done.stderr.startswith(b"error: ")
    assert done.stderr.count(b"\n") == 1
    assert b"\x1b" not in done.stderr

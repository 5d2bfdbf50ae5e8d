"""How the program ends: by an exit code that a script can tell, in one line, and with nothing left behind."""

import os
import pty
import re
import subprocess
import sys
from contextlib import suppress

import pytest

from tests.behaviour.suite import call, environment, start


@pytest.fixture(scope="module")
def scored(material, tmp_path_factory):
    """A folder with results of a descriptor; to be read only."""
    folder = tmp_path_factory.mktemp("scored")
    of_rods = ("-d", material / "rods", "-m", "surface-area", "-j", 0)
    assert call("run", *of_rods, "--results", folder / "results").code == 0
    return folder


def ended(process, timeout=60):
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
    assert subprocess.run(shell, env=environment(), timeout=60, check=False).returncode == 0
    assert (tmp_path / "tables.json").is_file()


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

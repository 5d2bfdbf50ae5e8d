"""Text from outside is one line that can be printed anywhere, and says what it said."""

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.text import clean

ANY = st.text(st.characters(codec=None, exclude_categories=()))


@given(ANY)
def test_whatever_it_was_it_can_be_printed_on_one_line(text):
    line = clean(text)
    assert line.isprintable()
    assert line.splitlines() in ([line], [])
    line.encode("utf-8")
    assert clean(line) == line


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a\nb", "a b"),
        ("a  \r\n\t b", "a b"),
        ("\x1b[31mred\x1b[0m", "red"),
        ("\x1b\x1b[31m[31mred", "\\x1b[31mred"),
        ("a\x00b", "a\\x00b"),
        ("caf\udce9.off", "caf\\udce9.off"),
        ("\u202egpj.exe", "\\u202egpj.exe"),
        ("a\u2028b\x85c\x0bd", "a b c d"),
        ("Übung † ±", "Übung † ±"),
        (None, "None"),
    ],
)
def test_what_cannot_be_printed_is_written_as_python_writes_it(text, told):
    assert clean(text) == told


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
    """One process for the whole way from an argument to the terminal: there is no such method, which is said."""
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
        command, capture_output=True, env=os.environ | settings, check=False, timeout=120
    )
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert done.stderr.startswith(b"error: ")
    assert done.stderr.count(b"\n") == 1
    assert b"\x1b" not in done.stderr

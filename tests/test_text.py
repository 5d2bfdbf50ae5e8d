"""Text from outside is one line that can be printed anywhere, and says what it said."""

from contextlib import redirect_stdout

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.text import Printed, clean_text

ANY = st.text(st.characters(codec=None, exclude_categories=()))


@given(ANY)
def test_whatever_it_was_it_can_be_printed_on_one_line(text):
    line = clean_text(text)
    assert line.isprintable()
    assert line.splitlines() in ([line], [])
    line.encode("utf-8")
    assert clean_text(line) == line


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
    assert clean_text(text) == told


def test_what_a_plugin_prints_last_is_shown_without_a_line_break_behind_it(capsys):
    printed = Printed()
    with redirect_stdout(printed):
        for step in ("first", "second"):
            printed.name = step
            print("one\ntwo", end="")
            print(" and more", end="")
    del printed
    shown = capsys.readouterr()
    assert shown.err.splitlines() == [
        "first: one",
        "first: two and more",
        "second: one",
        "second: two and more",
    ]
    assert not shown.out


def test_a_line_that_a_plugin_never_ends_takes_no_memory(capsys):
    printed = Printed()
    for _ in range(1000):
        print("." * 1000, end="", file=printed)
    assert len(printed._rest) < 10_000
    printed.close()
    assert capsys.readouterr().err.rstrip().endswith(". ...")

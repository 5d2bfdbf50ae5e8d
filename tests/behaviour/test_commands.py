"""Every verb with its options, as ``commands.txt`` lists them."""

from __future__ import annotations

import re
import shlex
from collections import defaultdict
from dataclasses import dataclass, field

import pytest

from tests.behaviour.suite import HERE, call

#: What needs no results of today.
WITHOUT_RESULTS = ("Names", "Data")


@dataclass
class Case:
    """A command, and what it must do."""

    line: str
    section: str
    code: int = 0
    parts: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))


def cases():
    section, found = "", []
    for line in (HERE / "commands.txt").read_text(encoding="utf-8").splitlines():
        kind, text = line[:2].strip(), line[2:].strip()
        if kind == "##":
            section = text
        elif kind == "$":
            words, _, mark = text.partition("#")
            case = Case(words.strip(), section, 2 if section == "Refusals" else 0)
            marks = [getattr(pytest.mark, mark.strip())] if mark else []
            found.append(pytest.param(case, id=case.line or "no words", marks=marks))
        elif kind == "?":
            case.code = int(text)
        elif kind in (">", "!", "-", "+"):
            case.parts[kind] += re.split(r"\s+" if kind == "+" else r"\s{2,}", text)
    return found


def plain(text):
    """Text with single blanks and without marks of bold and italic, and without numbers of notes on
    departures.
    """
    return " ".join(re.sub(r"\*+(?=[^\s*|])|(?<=[^\s*|])\*+| [⁰¹²³⁴⁵⁶⁷⁸⁹]+", "", text).split())


@pytest.mark.parametrize("case", cases())
def test_command(case, request):
    if case.section not in WITHOUT_RESULTS:
        request.getfixturevalue("ran")
    if "-j 0" in case.line:
        request.getfixturevalue("in_this_process")
    place = request.getfixturevalue("place")
    done = call(*shlex.split(case.line))
    out, err = plain(done.out), plain(done.err)
    assert done.code == case.code, done.out + done.err
    assert "Traceback" not in done.err
    for kind, text, shown in ((">", out, done.out), ("!", err, done.err)):
        unmarked = text.replace(" †", "").replace(" ‡", "")  # edited code marks its rows
        assert [
            part
            for part in map(plain, case.parts[kind])
            if part not in text and part not in unmarked
        ] == [], shown
    assert [part for part in case.parts["-"] if part in out + err] == []
    if case.section == "Refusals" and case.line:
        assert done.err.splitlines()[-1].startswith("error: ")
        assert done.err.count("error: ") == 1

    folders = tuple(name.removesuffix("...") for name in case.parts["+"] if name.endswith("/..."))
    written = {
        str(path.relative_to(place))
        for path in place.rglob("*")
        if path.is_file() and not path.is_symlink()
    }
    assert {name for name in written if not name.startswith(folders)} == set(case.parts["+"]) - {
        f"{f}..." for f in folders
    }
    assert all(any((place / name).iterdir()) for name in folders)

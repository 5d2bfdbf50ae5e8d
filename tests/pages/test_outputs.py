"""Pages show what their commands print.

A block of text is the output of the block of commands before it.
"""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.pages.test_docs import ROOT, TEXTS
from tests.verbs import call

PROGRAM = "python -m benchmark "

#: A block of commands, and the block of text that follows it.
SHOWN = re.compile(r"```sh\n((?:(?!```).)*)```\s+```text\n((?:(?!```).)*)```", re.DOTALL)

#: Seconds of a run, which depend on the machine.
SECONDS = re.compile(r"\(\.\d\d s\)|(?<=\|)[.\d]+\|$")


def outputs(page: str) -> list[tuple[str, list[str]]]:
    """Return the last command of each block with output, and the lines that it prints."""
    found = SHOWN.findall(TEXTS[ROOT / "docs" / page])
    return [(commands.splitlines()[-1], text.splitlines()) for commands, text in found]


def test_pages_show_outputs():
    assert len(outputs("how-to/run.md")) == 2
    assert len(outputs("how-to/results.md")) == 1
    assert len(outputs("reference/plugins.md")) == 2


def check_printed(command: str, shown: list[str]) -> None:
    """Call a verb, and compare what it prints with the lines of a page; ``...`` stands for any."""
    printed = call(*shlex.split(command.removeprefix(PROGRAM)))
    told = [SECONDS.sub("s", line.rstrip()) for line in printed.splitlines()]
    place = 0
    for line in shown:
        if line == "...":
            continue
        start, is_cut, _ = SECONDS.sub("s", line).partition("...")
        # Jobs run side by side, so the lines of those that end may come in any order.
        first = 0 if start.startswith("ok ") else place
        matching = [other.startswith(start) if is_cut else other == start for other in told[first:]]
        assert any(matching), (command, line, printed)
        place = max(place, first + matching.index(True) + 1)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the examples, in which commands run."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    return tmp_path


def test_published_scores_are_compared_as_the_page_shows(folder):
    ((command, shown),) = outputs("how-to/results.md")
    check_printed(command, shown)
    assert shown[0] == "A: mesh-unfolding"
    assert max(map(len, shown)) <= 80


def test_plugins_are_checked_and_described_as_the_page_shows(folder):
    blocks = re.findall(
        r"```python\n# (\w+\.py)\n(.*?)```", TEXTS[ROOT / "docs/reference/plugins.md"], re.DOTALL
    )
    for name, text in blocks:
        (folder / name).write_text(text, encoding="utf-8")
    (checked, findings), (described, facts) = outputs("reference/plugins.md")
    printed = call(*shlex.split(checked.removeprefix(PROGRAM)), code=1)
    assert printed.splitlines() == findings
    by_function = call("check", "flatten_by_function.py", code=1)
    assert by_function == printed
    assert "no fault was found" in call("check", "spectrum.py")
    check_printed(described, facts)


@pytest.mark.slow
def test_the_first_run_prints_what_the_page_shows(folder):
    from examples.bent_ellipsoids import write

    write(folder / "ellipsoids")
    for command, shown in outputs("how-to/run.md"):
        check_printed(command, shown)

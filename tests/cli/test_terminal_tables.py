"""Tables on a terminal: scores stay on one line, below their measures, at any width."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from benchmark.cli.terminal_tables import TerminalMarkdown

PUBLISHED = sorted((Path(__file__).parents[2] / "results" / "tables").glob("table-*.md"))


def shown(text, width):
    file = io.StringIO()
    Console(width=width, file=file).print(TerminalMarkdown(text))
    return [line.rstrip() for line in file.getvalue().splitlines()]


def score_cells(text):
    """Yield the cells of scores of a table of Markdown, as words without marks."""
    for line in text.splitlines():
        if line.startswith("|") and "---" not in line and "NN FT" not in line:
            for cell in line.strip("|").split("|")[1:]:
                words = cell.replace("*", "").split()
                if len(words) > 1 and any(re.search(r"\.\d", word) for word in words):
                    yield words


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("path", PUBLISHED, ids=lambda path: path.stem)
def test_published_tables_fit_a_terminal_with_the_scores_of_a_row_on_one_line(path, width):
    text = path.read_text()
    lines = shown(text, width)
    assert max(map(len, lines)) <= width
    joined = [" ".join(line.split()) for line in lines]
    for words in score_cells(text):
        assert any(" ".join(words) in line for line in joined), words


TABLE = """
|Method|paper: NN FT ST DCG|ours|s|
|---|---:|---:|---:|
|**Canonical forms**||||
|Classic MDS|.74 .54 .80 .80|*1.00* **.69** (.85) .90|.16|
||.30-.40 .50-.60 .70-.80 .90-1.00|||
|Identity (no canonical form)||failed|--|
"""


WIDE = """
                                                         paper                ours
Method                             NN      FT      ST      DCG    NN  FT   ST  DCG    s
───────────────────────────────────────────────────────────────────────────────────────
Canonical forms
Classic MDS                       .74     .54     .80      .80  1.00 .69 (.85) .90  .16
                              .30-.40 .50-.60 .70-.80 .90-1.00
Identity (no canonical form)                                                failed   --
"""

NARROW = """
                                             paper
Method                 NN      FT      ST      DCG
──────────────────────────────────────────────────
Canonical forms
Classic MDS           .74     .54     .80      .80
                  .30-.40 .50-.60 .70-.80 .90-1.00
Identity (no
canonical form)

                                         ours
Method                       NN  FT   ST  DCG    s
──────────────────────────────────────────────────
Canonical forms
Classic MDS                1.00 .69 (.85) .90  .16
Identity (no canonical                 failed   --
form)
"""


def test_scores_stand_below_their_measures():
    assert shown(TABLE, 100) == WIDE.splitlines()


def test_a_table_wider_than_the_terminal_is_continued_below_with_the_names_of_its_rows():
    assert shown(TABLE, 50) == NARROW.splitlines()

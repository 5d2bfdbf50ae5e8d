"""Figures in print: last bits decide neither a figure nor bold nor italic, in no format."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.protocols.tables import Table
from benchmark.report import html
from benchmark.report.comparison import compare_methods, lines
from benchmark.report.content import TableContent
from benchmark.report.escaping import number
from benchmark.report.formats import render
from benchmark.report.frame import figures
from benchmark.report.notes import notes
from benchmark.report.results import Result, line_of
from benchmark.report.robustness import half_at
from tests.records import MEASURES, record
from tests.report.tables import frame, line

HALVES = [k / 1000 for k in range(5, 1000, 10)]


def table(*results: Result) -> TableContent:
    """A row of each result, by mesh alone."""
    lines = frame(line(f"m{k}", "mesh", result) for k, result in enumerate(results))
    data = {"name": "rods", "title": "Rods", "stand_in_for": "", "quick": False, "n_shapes": 4, "n_classes": 2}
    return TableContent(Table("rods", "Rods", "rods"), data, ("mesh",), lines, dict.fromkeys(MEASURES, 0.25), 1)


def result(nn: float = 0.5, **more: object) -> Result:
    return Result(record(nn=nn, **more))


@pytest.mark.parametrize("value", HALVES)
def test_halves_go_up_on_either_side_of_the_last_bit(value):
    up = f"{round(value * 100 + 0.5) / 100:.2f}"
    assert {number(x) for x in (value, np.nextafter(value, 0), np.nextafter(value, 1))} == {up}


def test_further_decimals_signs_and_gaps():
    assert number(46 / 80) == number(np.mean([0.525, 0.625])) == "0.58"
    assert (number(0.0125, 3), number(1.25, 1), number(-0.125), number(-0.004), number(None)) == (
        "0.013", "1.3", "-0.13", "0.00", "--",
    )  # fmt: skip
    assert number(0.574999) == "0.57"  # six decimals are those of the records, and not rounded twice


def test_both_sides_of_a_half_are_one_figure_and_both_are_best_in_every_format():
    above, below = 0.575, float(np.nextafter(0.575, 0))
    content = table(result(above), result(below))
    files = render([content], ("latex", "markdown"))
    assert files["table-rods.md"].count("**0.58**") == 2
    assert files["table-rods.tex"].count(r"\textbf{0.58}") == 2
    said = "\n".join(
        lines(compare_methods([record("a", nn=below), record("b", nn=above, code="2")], "a", "b"), "a", "b")
    )
    assert "equal" in said


def test_the_best_row_is_the_first_of_those_that_print_alike():
    above, below = 0.575, float(np.nextafter(0.575, 0))
    judged = table(result(below), result(above)).significance
    assert [judged[name, "mesh"]["NN"].is_best for name in ("m0", "m1")] == [True, False]


def test_half_of_the_clean_value_is_not_below_half():
    third, sixth = 1 / 3, float(np.nextafter(1 / 6, 0))
    assert half_at(third, (sixth, 0.1), 0.1, (1.0, 2.0)) == 2.0
    assert half_at(third, (sixth,), sixth - 1e-15, (1.0,)) == "n/a"


NN = [1.0, 0.5, 1.0, 0.0]


def tied(values: list[float], codebooks: int = 1, **more: object) -> Result:
    per_query = {name: values if name == "NN" else [0.5] * 4 for name in MEASURES}
    made = record(nn=float(np.mean(values)), per_query=per_query, **more)
    made["recipe"] |= {"scorer": {"codebooks": list(range(codebooks))}}
    return Result(made)


def n_tied(*arguments: Any, **more: Any) -> int:
    return int(line_of([tied(*arguments, **more)], 1)["n_tied"])


def test_first_ranks_tie_where_nn_is_no_share_of_the_draws():
    assert n_tied(NN, tied_queries=1) == 1
    assert n_tied(NN, codebooks=2, tied_queries=1) == 0
    assert n_tied([0.666667, 0.333333, 1.0, 0.0], codebooks=3, tied_queries=4) == 0  # six decimals
    assert n_tied([0.666667, 0.166667, 1.0, 0.0], codebooks=3, tied_queries=4) == 1
    assert n_tied(NN) == 0  # of made-up or older records nobody knows


def test_a_row_whose_first_ranks_tie_is_marked_and_never_italic():
    best = result(0.75)
    without, having = (table(best, tied(NN, tied_queries=count)) for count in (0, 1))
    marks = [figures(each).query("measure == 'NN'")["mark"].tolist()[:2] for each in (without, having)]
    assert marks == [["best", "inseparable"], ["best", ""]]
    assert not any(one.is_inseparable for line in having.lines for one in having.judged(line).values())
    files = render([having], ("latex", "markdown"))
    assert "| M1 ‡ " in files["table-rods.md"]
    assert "| M0  " in files["table-rods.md"]
    assert r"M1 \ddag{}" in files["table-rods.tex"]
    note = "‡ Ties at the first rank: scores are means over their orders, and never italic: M1, mesh (1 of 4 queries)."
    assert note in notes(having)
    assert not any("‡" in line for line in notes(without))


@pytest.mark.skipif(not shutil.which("node"), reason="no node")
def test_pages_round_as_tables_do():
    script = Path(html.__file__).with_name("assets") / "report.js"
    (definition,) = re.findall(r"const number = .*", script.read_text(encoding="utf-8"))
    values = [*HALVES, *(float(np.nextafter(value, 0)) for value in HALVES), 0.0, 1.0, 0.574999, 0.0125]
    program = f"{definition} console.log(JSON.stringify({values}.map((x) => [number(x), number(x, 3)])));"
    done = subprocess.run(["node", "-e", program], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [[number(value), number(value, 3)] for value in values]

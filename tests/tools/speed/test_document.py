"""The tables of docs/appendix/speed.md say what the results say."""

from __future__ import annotations

import json

import pytest

from tools.speed import _document
from tools.speed._document import exponent, growth_table, speed_table
from tools.speed._timing import row

MACHINE = {"system": "Abacus", "python": "3.11", "cores": 2}


def test_the_ratio_is_the_time_of_the_peer_over_ours():
    measured = row("x", 0.25, peer="other", peer_seconds=1.0, target="faster", met=True, detail="equal results")
    assert measured["ratio"] == 4.0
    assert measured["detail"] == "target: faster; equal results"


def test_a_row_of_the_comparisons():
    rows = [
        row("x", 0.25, peer="other", peer_seconds=1.0, target="faster", met=True, detail="equal"),
        row("y", 2e-5, target="at most 1 µs", met=False, detail="alone", clock="wall"),
    ]
    lines = speed_table({"machine": MACHINE, "rows": json.loads(json.dumps(rows))}).splitlines()
    assert lines[2] == "| x | 250 ms | other | 1 s | 4.00 | processor | yes | faster; equal |"
    assert lines[3] == "| y | 20 µs |  |  |  | wall | **no** | at most 1 µs; alone |"
    assert lines[-1] == "Measured on Abacus, Python 3.11, 2 cores."


def test_a_method_that_takes_too_long_says_where_it_stopped():
    rows = [
        {"name": "slow", "takes_rows": False, "seconds": [4.0, 64.0]},
        {"name": "quick", "takes_rows": True, "seconds": [1.0, 2.0, 4.0]},
    ]
    rows.append({"name": "not asked", "takes_rows": False, "seconds": [1.0, 2.0]})
    lines = growth_table([500, 1000, 2000], rows, 60.0).splitlines()
    assert lines[2] == "| slow | 4 s | 64 s | stopped | 4.0 |"
    assert lines[3] == "| quick * | 1 s | 2 s | 4 s | 1.0 |"
    assert lines[4] == "| not asked | 1 s | 2 s |  | 1.0 |"


def test_rows_of_two_machines_say_which_is_which():
    rows = [row(name, 1.0, target="fast", met=True, detail="") for name in ("here", "there")]
    rows[1]["machine"] = {**MACHINE, "system": "Quipu"}
    text = speed_table({"machine": MACHINE, "rows": rows})
    assert "Measured on Abacus, Python 3.11, 2 cores: here." in text
    assert "Measured on Quipu, Python 3.11, 2 cores: there." in text


def test_the_exponent_keeps_silent_where_the_clock_cannot_tell():
    assert exponent([1, 2], [1e-6, 8e-6]) == ""
    assert exponent([1, 2], [1.0, 8.0]) == "3.0"


def test_the_document_holds_whatever_results_exist(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / _document.DOCUMENT).parent.mkdir(parents=True)
    (tmp_path / "results").mkdir()
    path = _document.write_document()
    assert "##" not in path.read_text()
    measured = row("x", 1.0, target="none", met=True, detail="")
    _document.SPEED.write_text(json.dumps({"machine": MACHINE, "rows": [measured]}))
    assert "| x | 1 s |" in _document.write_document().read_text()

"""What the README and the pages that it leads to promise is what the project does."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.reference import paper
from retrieval.chance import chance_levels
from retrieval.measures import PRINTED
from tests.rows import is_form
from tests.toy import write_rods

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
IN_PYTHON = (ROOT / "docs" / "how-to" / "results.md").read_text(encoding="utf-8")
REPRODUCTION = (ROOT / "results" / "tables" / "reproduction.md").read_text(encoding="utf-8")


def python_with(text: str) -> str:
    """The one block of Python with a text in it."""
    blocks = re.findall(r"```python\n(.*?)```", README + IN_PYTHON, re.DOTALL)
    (block,) = (block for block in blocks if text in block)
    return block


def plugin() -> str:
    return python_with("class Smooth")


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """The current folder is one with the published results and nothing that ran here, without official data."""
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "records").symlink_to(ROOT / "results" / "records")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CANONICAL_FORMS_DATA", raising=False)
    return tmp_path


@pytest.mark.slow
def test_results_are_read_as_shown_after_a_quick_run(clone):
    """As a script of its own, word by word; a job of `make bench` is all that it needs."""
    quick = ["run", "-t", "III", "-m", "gps", "--input", "mesh", "--quick", "-j", "0"]
    assert CliRunner().invoke(cli, quick).exit_code == 0
    told = "\nprint(len(queries), distances.shape, len(forms), min(form.n_faces for form in forms.values()) > 100)\n"
    (clone / "script.py").write_text(python_with("open_results") + told)
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, timeout=100, check=False)
    assert (done.stdout, done.stderr) == ("80 (26, 26) 26 True\n", "")


def test_the_first_half_of_that_works_with_what_came_with_the_suite(clone):
    found: dict[str, Any] = {}
    exec(python_with("open_results").partition("\nhere")[0], found)  # noqa: S102
    assert len(found["queries"]) == 80
    assert {"shape", "subject", "NN", "FT", "ST", "DCG", "E", "mAP"} <= set(found["queries"].columns)


@pytest.mark.slow
def test_the_plugin_appears_as_a_row(tmp_path):
    (tmp_path / "smooth.py").write_text(plugin())
    write_rods(tmp_path / "rods")
    words = ["run", "-d", tmp_path / "rods", "-m", "identity", "--input", "mesh", "--results", tmp_path / "results"]
    command = [sys.executable, "-m", "benchmark", *words, "--plugin", tmp_path / "smooth.py"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert "| Smoothed" in done.stdout


def rows_in(text: str) -> list[dict[str, str]]:
    """Rows of the table of a Markdown text, by the heads of its columns."""
    lines = re.findall(r"^\|(.*)\|$", text, re.MULTILINE)
    head, _, *rows = ([cell.strip() for cell in line.split("|")] for line in lines)
    return [dict(zip(head, row, strict=True)) for row in rows]


def test_the_rows_of_the_readme_are_those_of_table_three():
    table = (ROOT / "results" / "tables" / "table-III-tosca.md").read_text(encoding="utf-8")
    committed = rows_in(re.sub(" [⁰¹²³⁴⁵⁶⁷⁸⁹]+", "", table))  # the numbers are those of notes below that table
    rows = rows_in(README)
    assert len(rows) == 6
    assert f"Six of the {len(committed) - 1} rows" in README
    assert [row for row in rows if not any(row.items() <= full.items() for full in committed)] == []


def shown() -> dict[tuple[str, str, str], dict[str, float]]:
    """Our scores in the committed tables by table, input and method; of Table III that of TOSCA."""
    rows = json.loads((ROOT / "results" / "tables" / "tables.json").read_text(encoding="utf-8"))
    chosen = [row for row in rows if row["NN"] is not None and row["dataset"] != "animals"]
    found = {(row["table"], row["input"], row["method"]): row for row in chosen}
    assert len(found) == len(chosen)
    return found


def forms(table: str, input_: str) -> dict[str, dict[str, float]]:
    """Scores of the canonical forms that need no training, by method."""
    return {
        method: row
        for (of_table, of_input, method), row in shown().items()
        if (of_table, of_input) == (table, input_) and is_form(method)
    }


def test_the_classical_rows_of_tosca_come_out_again():
    outcomes = {
        name: sum(int(cell) for cell in line.split("|")[4:5])
        for line in REPRODUCTION.partition("**The paper's claims.**")[0].splitlines()
        if (name := "|".join(line.split("|")[1:3]).strip()).startswith("III | mesh")
    }
    assert list(outcomes.values()) == [23]
    assert "23 of 32 figures within .05" in README
    near = [
        abs(row.values["III"][measure] - forms("III", "mesh")[name][measure]) <= 0.05 + 5e-7
        for name, row in paper.rows("III").items()
        if name != "learned"
        for measure in PRINTED
    ]
    assert (sum(near), len(near)) == (23, 32)


def test_chance_comes_as_near_to_the_papers_real_humans_as_any_figure_can() -> None:
    rows = [row for name, row in paper.rows("II").items() if name != "learned"]
    chance = chance_levels([subject for subject in range(40) for _ in range(10)])
    near = [abs(row.values["II"][measure] - chance[measure]) <= 0.05 for row in rows for measure in PRINTED]
    assert f"within .05 of {sum(near)} of its {len(near)}" in README
    assert all(row["NN"] < 0.1 for name, row in forms("II", "view").items() if name not in {"gps"} and "[" not in name)


@pytest.mark.parametrize("table", ["I", "III"])
def test_the_surface_area_beats_every_canonical_form_of_complete_surfaces(table):
    area, rows = shown()[table, "mesh", "surface-area"], forms(table, "mesh")
    assert len(rows) >= 10
    assert all(area[measure] > row[measure] for row in rows.values() for measure in PRINTED)
    assert all(shown()[numeral, "mesh", "si-hks"]["NN"] >= 0.975 - 5e-7 for numeral in ("I", "II", "III"))

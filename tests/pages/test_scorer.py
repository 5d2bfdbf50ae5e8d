"""What docs/reference/scorers.md says of the two scorers is what the committed records say."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from retrieval.measures import PRINTED
from tests.rows import is_form
from tests.verbs import call

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "scorers.md").read_text(encoding="utf-8")


def told(*arguments: str) -> str:
    return call(*arguments, "--published", "--results", ROOT / "results")


@pytest.fixture(scope="module")
def agreement() -> list[str]:
    """Lines of the table of Kendall's tau."""
    return [line for line in told("compare", "cm-bof", "spherical-harmonics").splitlines() if line.startswith("|")]


def test_all_orders_are_alike_and_none_is_the_same(agreement: list[str]) -> None:
    taus = [float(each) for line in agreement[2:] for each in re.findall(r"(-?[\d.]+) \(", line)]
    assert len(taus) == 4 * 8
    assert (min(taus), max(taus)) == (0.04, 0.68)
    assert "between .04 and .68" in PAGE
    assert f"{sum(float(p) < 0.05 for p in re.findall(r'[(]([.0-9]+)[)]', ' '.join(agreement)))} of the 32" in PAGE


def scores(table: str, input_: str) -> dict[str, dict[str, float]]:
    """Scores by spherical harmonics of each row."""
    text = told("tables", "--scorer", "spherical-harmonics", "-t", table, "--input", input_, "--format", "json")
    rows = json.loads(text)
    return {row["method"]: row for row in rows if row["table"] == table and row["NN"] is not None}


@pytest.mark.parametrize(
    ("winner", "table", "input_"),
    [("learned", "I", "view"), ("surface-area", "I", "mesh"), ("surface-area", "III", "mesh")],
)
def test_what_the_readme_says_of_two_rows_holds_by_the_other_scorer(winner: str, table: str, input_: str) -> None:
    found = scores(table, input_)
    forms = [name for name in found if is_form(name)]
    assert len(forms) >= 20
    assert all(found[winner][measure] > found[name][measure] for name in forms for measure in PRINTED)

"""What docs/explanation/robustness.md reads from the curves is what the committed figures say."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tests.rows import is_form

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "explanation" / "robustness.md").read_text(encoding="utf-8")
CURVES = json.loads((ROOT / "results" / "tables" / "robustness.json").read_text(encoding="utf-8"))

Point = Mapping[str, Any]


def halves(input_: str, points: Iterable[Point]) -> dict[tuple[str, str], float]:
    """First amount at which a method has less than half of its clean NN, by method and perturbation."""
    return {
        (each["method"], each["perturbation"]): each["half_at"]
        for each in points
        if each["input"] == input_ and each["half_at"] is not None
    }


def forms() -> list[Point]:
    """The points of canonical forms: no descriptors, no controls."""
    return [each for each in CURVES if is_form(each["method"])]


def test_only_forms_of_the_spectrum_fall_below_half_on_complete_surfaces() -> None:
    assert halves("mesh", forms()) == {
        ("gps", "missing-parts"): 0.1,
        ("gps", "shortcuts"): 5,
    }


def test_what_breaks_the_descriptors_of_complete_surfaces() -> None:
    others = [each for each in CURVES if not is_form(each["method"])]
    assert halves("mesh", others) == {
        ("shape-dna", "missing-parts"): 0.05,
        ("surface-area", "noise"): 0.008,
        ("surface-area", "shortcuts"): 5,
    }


def test_what_breaks_the_rows_of_single_views() -> None:
    assert halves("view", CURVES) == {
        ("gps", "view-angle"): 60,
        ("shape-dna", "view-angle"): 45,
        ("classic-mds", "depth-noise"): 0.001,
        ("gps", "depth-noise"): 0.008,
    }
    moved = [
        abs(each["NN"] - each["clean_NN"])
        for each in CURVES
        if (each["method"], each["input"]) == ("mesh-unfolding", "view")
    ]
    assert max(moved) < 0.13
    assert "within .13" in PAGE

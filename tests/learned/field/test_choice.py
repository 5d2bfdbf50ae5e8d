"""The choice of detail at toy size: every setting is ranked once, the bare prediction and the input among them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from learned.field import configuration, training
from learned.field.fitting import fit
from learned.field.methods import DeformationField
from tests.learned.field.toy import OPTIONS, TOY, Paddles, paddles
from tests.learned.toy import quiet
from tools.studies import field_detail


def test_every_setting_is_ranked_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(configuration.FIELDS, TOY.name, TOY)
    monkeypatch.setattr(training, "LOOKED_AT", 2)
    ranked: list[tuple[list[Any], tuple[str, ...]]] = []

    def scored(forms: Any, subjects: Any) -> dict[str, float]:
        ranked.append(([each.vertices for each in forms], tuple(subjects)))
        return dict.fromkeys(("NN", "FT", "ST", "DCG"), 0.5) | {f"chance {n}": 0.2 for n in ("NN", "FT", "ST", "DCG")}

    monkeypatch.setattr(field_detail, "ranked", scored)
    folder, figures = tmp_path / "field-toy-seed0", tmp_path / "results" / "field-detail.json"
    fit("toy", 0, paddles(), folder, OPTIONS, quiet)
    method = DeformationField(configuration="toy").load(folder)
    bodies = Paddles(2).surfaces(0, 2)
    field_detail.compare(method, bodies, figures)
    field_detail.compare(method, bodies, figures)
    found = json.loads(figures.read_text())
    assert [row["form"] for row in found] == [
        "input",
        "reach 0, rounds 0",
        *(f"reach {a:g}, rounds {b}" for a in field_detail.REACHES[1:] for b in field_detail.ROUNDS),
    ]
    assert len(ranked) == len(found)
    assert {subjects for _, subjects in ranked} == {("paddle-0-0",) * 2 + ("paddle-0-1",) * 2}
    forms = [of_setting[0].tobytes() for of_setting, _ in ranked]
    assert len(set(forms)) == len(forms), "each setting has forms of its own"
    assert found[0]["edge strain"] == 0 < min(row["edge strain"] for row in found[1:])
    lines = field_detail.table(found).splitlines()
    assert lines[2] == "| input | 0.50 | 0.50 | 0.50 | 0.50 | 0.000 |"
    assert lines[-1] == "| *chance* | 0.20 | 0.20 | 0.20 | 0.20 |  |"

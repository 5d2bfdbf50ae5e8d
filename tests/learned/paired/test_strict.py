"""The galleries that take the strict row apart: which model makes which form, and who is ranked against whom."""

from __future__ import annotations

from typing import Any

import pytest

from benchmark.protocols.trainings import POSE_FOLDS
from tools.studies import strict_training
from tools.studies.strict_training import ROWS, Form, compared, table


def test_each_row_takes_forms_of_its_models_in_galleries_of_its_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    ranked: list[tuple[list[Any], list[str]]] = []

    def scored(forms: Any, subjects: Any) -> dict[str, float]:
        ranked.append((list(forms), list(subjects)))
        return {name: len(ranked) / 100 for name in ("NN", "FT", "ST", "DCG", "chance NN")}

    monkeypatch.setattr(strict_training, "ranked", scored)
    trainings = ("learned", "learned[training_seed=1]", "learned-strict")
    forms = {
        name: [[Form(f"{fold}{subject}", pose, (name, fold, pose)) for subject in "ab" for pose in range(20)]
               for fold in range(3)]
        for name in trainings
    }  # fmt: skip
    found = [compared(name, forms) for name in ROWS]
    assert [row["galleries"] for row in found] == [3, 3, 3, 12, 12]
    assert len(ranked) == 3 + 3 + 3 + 12 + 12
    assert found[0]["NN"] == pytest.approx(0.02), "the mean over its galleries"
    whole, mixed, strict, first, last = (ranked[place] for place in (0, 3, 6, 9, 32))
    assert sorted(whole[1]) == ["0a"] * 20 + ["0b"] * 20
    assert {form[0] for form in whole[0]} == {"learned"}
    for name, fold, pose in mixed[0]:
        number = next(place for place, poses in enumerate(POSE_FOLDS) if pose in poses)
        assert (name, fold) == (("learned", "learned[training_seed=1]")[number % 2], 0)
    assert {form[0] for form in strict[0]} == {"learned-strict"}
    assert sorted(form[2] for form in first[0]) == sorted(2 * POSE_FOLDS[0])
    assert {form[:2] for form in last[0]} == {("learned-strict", 2)}
    assert sorted(form[2] for form in last[0]) == sorted(2 * POSE_FOLDS[3])
    assert len(table(found).splitlines()) == 2 + len(ROWS)

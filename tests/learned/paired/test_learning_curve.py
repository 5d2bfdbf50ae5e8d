"""What stands at a mark of the learning curve is what a training of so many epochs ends with, stopped or not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import pytest
import torch
from torch import nn

from learned.paired.pairs import gather
from learned.paired.schedule import Schedule
from learned.paired.training import train
from tests.learned.toy import TINY, files, quiet, run_in, toy_data
from tools.studies import learning_curve

PLAN = Schedule(resolution=32, early_epochs=2, batch=2, precision="float32")


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[int, dict[str, torch.Tensor]]:
    """Weights at each mark of a curve of the tiny network over the toy data."""
    weights: dict[int, dict[str, torch.Tensor]] = {}

    def measured(network: nn.Module, *_: Any) -> dict[str, float]:
        weights[len(weights)] = {name: tensor.clone() for name, tensor in network.state_dict().items()}
        return {}

    for name, value in {
        "LITERAL": TINY, "FOLDER": tmp_path / "work", "say": quiet, "FIGURES": tmp_path / "curve.json",
        "measure": measured, "training_data": lambda *_: toy_data(),
    }.items():  # fmt: skip
        monkeypatch.setattr(learning_curve, name, value)
    return weights


def trained_for(epochs: int, folder: Path) -> dict[str, torch.Tensor]:
    folder.mkdir()
    pairs, plan = gather(toy_data().pairs(), PLAN.resolution), replace(PLAN, epochs=epochs)
    return train(TINY, plan, pairs, None, run_in(folder)).network.state_dict()


def test_a_mark_is_the_end_of_a_training_of_so_many_epochs(seen: Any, tmp_path: Path) -> None:
    rows = learning_curve.curve(PLAN, (3, 5))
    assert rows == json.loads((tmp_path / "curve.json").read_text())
    assert [row["epochs"] for row in rows] == [3, 5]
    for mark, found in zip((3, 5), seen.values(), strict=True):
        expected = trained_for(mark, tmp_path / str(mark))
        assert all(torch.equal(found[name], expected[name]) for name in expected)


def test_a_mark_that_was_measured_is_not_measured_again(seen: Any, tmp_path: Path) -> None:
    learning_curve.curve(PLAN, (3,))
    learning_curve.curve(PLAN, (5, 3))
    assert len(seen) == 2
    expected = trained_for(5, tmp_path / "5")
    assert all(torch.equal(seen[1][name], expected[name]) for name in expected)


def test_a_mark_below_the_checkpoint_is_refused(seen: Any) -> None:
    learning_curve.curve(PLAN, (5,))
    with pytest.raises(click.ClickException, match="stands at epoch 5: delete it to measure 3"):
        learning_curve.curve(PLAN, (3,))


def test_another_resolution_has_rows_of_its_own_below(seen: Any) -> None:
    learning_curve.curve(replace(PLAN, resolution=64), (2,))
    rows = learning_curve.curve(PLAN, (2, 3))
    assert [(row["resolution"], row["epochs"]) for row in rows] == [(32, 2), (32, 3), (64, 2)]
    assert len(seen) == 3


def test_the_table_and_the_picture_of_a_curve(tmp_path: Path) -> None:
    scores = {"NN": 0.5, "FT": 0.25, "ST": 0.4, "DCG": 0.6}
    row = {
        "resolution": 128, "epochs": 30, "seconds": 1, **scores,
        **{f"chance {name}": value / 2 for name, value in scores.items()},
        **{f"{kind} {name}": 0.125 for kind in ("training", "validation") for name in ("mask overlap", "depth error")},
    }  # fmt: skip
    lines = learning_curve.table([row, {**row, "epochs": 60}]).splitlines()
    assert lines[2] == "| 128 | 30 | 0.50 | 0.25 | 0.40 | 0.60 | 0.12 | 0.125 | 0.125 |"
    learning_curve.draw([row, {**row, "epochs": 60}], tmp_path / "curve.png")
    assert files(tmp_path) == {"curve.png"}

"""From data to a folder: everything that a card promises, pictures, and a finished model that is left alone."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from benchmark.api.learning import CARD, WEIGHTS, TrainingData, read_card
from benchmark.errors import ConfigurationError, TrainingError
from learned.paired.fitting import fit
from learned.paired.model import load_model, predict
from learned.paired.pairs import gather
from learned.paired.schedule import schedule
from learned.training.fitting import HISTORY
from learned.training.loop import measures
from tests.learned.toy import OPTIONS, TINY, files, toy_data

PICTURES = {"history.png", "samples-training.png", "samples-unseen.png"}


def again(
    folder: Path, options: Mapping[str, Any] = OPTIONS, *, seed: int = 0, data: TrainingData | None = None
) -> list[str]:
    """Ask for the same training, or for another; returns what it says."""
    messages: list[str] = []
    fit(TINY.name, seed, data or toy_data(), folder, options, messages.append)
    return messages


def test_the_folder_holds_a_model_and_pictures_and_nothing_else(trained: Path) -> None:
    assert files(trained) == {WEIGHTS, CARD, HISTORY, *PICTURES}


def test_the_card_tells_the_schedule_that_was_used(trained: Path) -> None:
    card = read_card(trained)
    settings = {name: value for name, value in OPTIONS.items() if name not in ("device", "threads")}
    assert settings.items() <= card["schedule"].items()
    assert card["schedule"]["batch_at_the_end"] == OPTIONS["batch"]
    assert (card["schedule"]["early_alpha"], card["schedule"]["alpha"], card["schedule"]["beta"]) == (0.01, 1, 1)
    assert card["departures_from_the_paper"] == schedule({}, settings).non_default_settings()
    assert card["schedule_in_words"].startswith("32 x 32 pixels, 30 epochs, batch 2, early_epochs 5 (paper: 100)")


def test_the_card_tells_the_losses_of_the_last_epoch(trained: Path) -> None:
    card = read_card(trained)
    with (trained / HISTORY).open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["epoch"]) for row in rows] == list(range(1, 31))
    assert [float(row["alpha"]) for row in rows] == [0.01] * 5 + [1.0] * 25
    last = {name: float(text) for name, text in rows[-1].items() if text}
    assert last == pytest.approx(card["final_losses"], rel=1e-5)
    assert set(last) > {"depth loss", "mask loss", "loss", "unseen mask overlap", "unseen depth error"}
    assert last["mask loss"] < 0.3 * float(rows[0]["mask loss"])


def test_the_card_tells_the_measures_of_the_finished_model(trained: Path) -> None:
    network, card = load_model(trained)
    for kind, pairs in (("training", toy_data().pairs()), ("unseen", toy_data().unseen())):
        gathered = gather(pairs, 32)
        predictions = torch.stack([predict(network, image) for image in gathered.images])
        # The card was written before the weights were rounded to half precision.
        assert measures(predictions, gathered.targets[gathered.target_of]) == pytest.approx(
            card["final"][kind], abs=5e-3
        )
    assert card["final"]["training"]["mask overlap"] > 0.8


@pytest.mark.usefixtures("tiny")
def test_a_finished_model_is_left_alone(trained: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in trained.iterdir()}
    # Where it is computed is not part of what determines the model.
    assert again(trained, {**OPTIONS, "threads": 2, "device": "auto"}) == [f"{trained} holds this model already"]
    assert {path: path.stat().st_mtime_ns for path in trained.iterdir()} == before


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("other", [{"epochs": 31}, {"learning_rate": "1e-3"}, {"depth_loss": "masked"}])
def test_other_options_do_not_touch_a_finished_model(trained: Path, other: dict[str, Any]) -> None:
    before = (trained / CARD).read_bytes()
    with pytest.raises(ConfigurationError, match="holds a finished model of another training .*delete the folder"):
        again(trained, {**OPTIONS, **other})
    assert (trained / CARD).read_bytes() == before


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epoch": 3}, "unknown parameter of the schedule 'epoch'; did you mean epochs"),
        ({"threads": "many"}, "'many' does not fit threads of the training; write a whole number of at least 1"),
        ({"threads": "0"}, "'0' does not fit threads of the training"),
        ({"device": "tpu"}, "unknown device of the training 'tpu'; did you mean cpu"),
        ({"resolution": 16}, "network 'tiny' has no resolution 16; pass --resolution 32 to 2048"),
    ],
)
def test_an_option_that_does_not_fit_leaves_no_folder(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        again(tmp_path / "model", {**OPTIONS, **options})
    assert files(tmp_path) == set()


@pytest.mark.usefixtures("tiny")
def test_no_pair_is_no_training(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="no pair to train on"):
        again(tmp_path, data=replace(toy_data(), pairs=lambda start=0: iter(())))


@pytest.mark.usefixtures("tiny")
def test_a_measure_that_is_no_number_is_null_on_the_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Predictions that nowhere overlap their targets have no error of depth."""
    values = {"mask overlap": 0.0, "depth error": float("nan")}
    monkeypatch.setattr("learned.paired.fitting.measures", lambda *_: values)
    again(tmp_path / "model", {**OPTIONS, "epochs": 2, "early_epochs": 1})
    assert read_card(tmp_path / "model")["final"]["unseen"] == {"mask overlap": 0.0, "depth error": None}

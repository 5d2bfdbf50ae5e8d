"""A user's own data: train on a folder without some of its subjects, and rank it with the model."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import benchmark
from benchmark.api.learning import CARD, digest_of
from benchmark.errors import ConfigurationError
from benchmark.protocols.trainings import find_training, own_training
from tests.toy import write_rods
from tests.verbs import call

WIDTHS = {"anna": 0.08, "ben": 0.12, "carl": 0.2}


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rods, of which a straight one would be seen end on."""
    folder = tmp_path_factory.mktemp("data") / "my scans"
    return write_rods(folder, (1.0, 1.5, 2.0), rings=12, sides=8, radii=WIDTHS)


def test_a_folder_is_trained_on_without_the_subjects_that_are_held_out(
    scans: Path, tmp_path: Path
) -> None:
    small = (
        "-o",
        "resolution=32",
        "-o",
        "epochs=1",
        "-o",
        "device=cpu",
        "--results",
        tmp_path,
    )
    said = call("train", "learned", "--data", scans, "--hold-out", "ben", *small)
    model = tmp_path / "models" / "own-my-scans" / "literal-seed0"
    assert f"the model is in {model}" in said.replace("\n", "")
    card = json.loads((model / CARD).read_text())
    assert (card["subjects"], card["tested"], card["pairs"]) == (
        ["anna", "carl"],
        digest_of(["ben"]),
        6,
    )
    row = (
        "-d",
        scans,
        "-m",
        "learned[training=own-my-scans]",
        "--input",
        "view",
        "--results",
        tmp_path,
    )
    assert "never run" in call("plan", *row)
    again = call("train", "learned", "--data", scans, "--hold-out", "ben", *small)
    assert "holds this model already" in again
    options = {"resolution": 32, "epochs": 1, "device": "cpu"}
    (known,) = benchmark.train(
        "learned", data=scans, hold_out="ben", options=options, results=tmp_path
    )
    assert known == model


@pytest.mark.parametrize(
    ("hold_out", "message"),
    [
        ((), "hold out some"),
        (("bens",), "did you mean ben"),
        (tuple(WIDTHS), "has no subject left to train on; hold out fewer"),
    ],
)
def test_what_cannot_be_held_out_is_named(
    scans: Path, hold_out: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        own_training(scans, hold_out)


def test_a_model_of_own_data_is_found_by_name() -> None:
    assert not find_training("own-my-scans").is_sampled
    with pytest.raises(ConfigurationError, match="unknown training 'owned'"):
        find_training("owned")

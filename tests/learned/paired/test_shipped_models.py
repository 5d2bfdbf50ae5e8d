"""The models that come with the project: whole, small, and trained on nothing that they are tested on."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmark.datasets.humans import Humans
from benchmark.learning import CARD, WEIGHTS, card_digest, read_card
from benchmark.storage.store import Store
from learned.paired.methods import Learned
from learned.paired.model import load_model
from learned.weights import n_parameters

ROOT = Path(__file__).parents[3]
MEBIBYTES = 20
SUBJECTS = list(dict.fromkeys(entry.subject for entry in Humans().entries))

Card = dict[str, Any]


@pytest.fixture(scope="module")
def cards() -> dict[Path, Card]:
    """Card of each shipped model by its folder."""
    return {path.parent: read_card(path.parent) for path in sorted(Learned.shipped_models.glob(f"*/*/{CARD}"))}


@pytest.fixture
def of_data(cards: dict[Path, Card], request: pytest.FixtureRequest) -> list[Card]:
    """Cards of the models whose training has a name that matches."""
    found = [card for folder, card in cards.items() if re.fullmatch(request.param, folder.parent.name)]
    assert found, f"no model is shipped that was trained on {request.param}"
    return found


def test_every_model_is_the_one_that_its_card_describes(cards: dict[Path, Card]) -> None:
    for folder in cards:
        network, card = load_model(folder)
        assert n_parameters(network) == card["parameters"]


def test_every_folder_is_named_after_what_it_holds(cards: dict[Path, Card]) -> None:
    for folder, card in cards.items():
        assert folder.parent.name == card["data"]
        assert folder.name == f"{card['configuration']['name']}-seed{card['seed']}"


def test_no_file_is_large(cards: dict[Path, Card]) -> None:
    for folder in cards:
        assert (folder / WEIGHTS).is_file()
        assert max(path.stat().st_size for path in folder.iterdir()) <= MEBIBYTES * 2**20


@pytest.mark.parametrize("of_data", ["humans-fold-[012]"], indirect=True)
def test_no_model_of_a_fold_has_seen_its_subjects(of_data: list[Card]) -> None:
    for card in of_data:
        fold = int(card["data"][-1])
        tested = {subject for place, subject in enumerate(SUBJECTS) if (place + place // 3) % 3 == fold}
        assert len(tested) == 5
        assert set(card["subjects"]) == set(SUBJECTS) - tested
        assert set(card["identifiers"]) == {
            entry.identifier for entry in Humans().entries if entry.subject not in tested
        }


@pytest.mark.parametrize("of_data", ["(tosca|animals)-III.*"], indirect=True)
def test_neither_cat_nor_horse_is_seen_by_a_model_of_table_3(of_data: list[Card]) -> None:
    for card in of_data:
        assert not [name for name in card["identifiers"] if re.match("cat|horse", name)]
        assert not {"cat", "horse"} & set(card["subjects"])


@pytest.mark.parametrize("of_data", ["humans-sampled"], indirect=True)
def test_sampled_bodies_are_none_of_the_data_set(of_data: list[Card]) -> None:
    for card in of_data:
        assert not set(card["identifiers"]) & {entry.identifier for entry in Humans().entries}
        assert card["extra_data"]


@pytest.mark.slow
def test_table_one_needs_no_training(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmark", "run", "-t", "I", "-m", "learned", "--input", "view", "--quick"]
    done = subprocess.run(
        [*command, "--results", str(tmp_path)], capture_output=True, text=True, cwd=ROOT, timeout=280, check=False
    )
    assert done.returncode == 0, done.stderr
    (record,) = Store.open(tmp_path).records
    assert record["n_shapes"] == 15
    assert record["seen"] == []
    card = read_card(Learned.shipped_models / "humans-fold-0" / "literal-seed0")
    assert record["models"][0]["digest"] == card_digest(card)[:16]
    # Three poses of five subjects: random order finds a shape of the subject first in a seventh of the queries.
    assert record["scores"]["NN"] > 2 * record["chance"]["NN"]
    assert "128 x 128 pixels, 60 epochs" in done.stdout

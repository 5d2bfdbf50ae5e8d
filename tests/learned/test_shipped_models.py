"""The models that come with the project: whole, small, and trained on nothing that they are tested on."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import nn

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.datasets import human_subjects
from benchmark.datasets.animals import Animals
from benchmark.datasets.animals.generate import SPECIES
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import adults, clearance, clearances
from benchmark.datasets.humans import CANONICAL_POSE, Humans
from benchmark.datasets.varied.bodies import AWAY_FROM, varied_body
from benchmark.datasets.varied_animals import SPECIES_IN_TURN
from benchmark.datasets.varied_animals.proportions import drawn_species
from benchmark.pipeline.method_run import Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.protocols.pairs import synthetic
from benchmark.protocols.trainings import find_training
from learned.field.model import load_field
from learned.paired.methods import Learned
from learned.paired.model import load_model
from learned.streamed.methods import StreamedLearner
from learned.streamed.model import load_streamed
from learned.weights import n_parameters

ROOT = Path(__file__).parents[2]
MEBIBYTES, ALL_MEBIBYTES = 20, 120
SUBJECTS = list(dict.fromkeys(entry.subject for entry in Humans().entries))

#: Networks of a model by what its card calls its configuration.
LOADED: dict[str, Callable[[Path], nn.Module]] = {
    "configuration": lambda folder: load_model(folder)[0],
    "field": load_field,
    "streamed": lambda folder: load_streamed(folder)[0],
}

Card = dict[str, Any]


@pytest.fixture(scope="module")
def cards() -> dict[Path, Card]:
    """Card of each shipped model by its folder."""
    return {path.parent: read_card(path.parent) for path in sorted(Learned.shipped_models.glob(f"*/*/{CARD}"))}


@pytest.fixture
def of_data(cards: dict[Path, Card], request: pytest.FixtureRequest) -> list[Card]:
    """Cards of the models whose training has a name that matches."""
    matching = [card for folder, card in cards.items() if re.fullmatch(request.param, folder.parent.name)]
    assert matching, f"no model is shipped that was trained on {request.param}"
    return matching


def test_every_model_is_the_one_that_its_card_describes(cards: dict[Path, Card]) -> None:
    for folder, card in cards.items():
        for kind, load in LOADED.items():
            if kind in card:
                assert n_parameters(load(folder)) == card["parameters"]
                break
        else:
            pytest.fail(f"{folder} holds a model of no kind")


def test_every_folder_is_named_after_what_it_holds(cards: dict[Path, Card]) -> None:
    for folder, card in cards.items():
        assert folder.parent.name == card["data"]
        kind = next(kind for kind in LOADED if kind in card)
        prefix = "" if kind == "configuration" else f"{kind}-"
        assert folder.name == f"{prefix}{card[kind]['name']}-seed{card['seed']}"


def test_no_file_is_large(cards: dict[Path, Card]) -> None:
    for folder in cards:
        assert (folder / WEIGHTS).is_file()
        assert max(path.stat().st_size for path in folder.iterdir()) <= MEBIBYTES * 2**20
    assert sum(path.stat().st_size for path in Learned.shipped_models.rglob("*")) <= ALL_MEBIBYTES * 2**20


@pytest.mark.parametrize("of_data", ["humans-strict-[012]-[0123]"], indirect=True)
def test_no_strict_model_has_seen_its_subjects_or_its_poses(of_data: list[Card]) -> None:
    assert len(of_data) == 12
    for card in of_data:
        fold, part = map(int, card["data"].split("-")[2:])
        tested = {subject for place, subject in enumerate(SUBJECTS) if (place + place // 3) % 3 == fold}
        poses = {pose for place, pose in enumerate(POSES) if place // 5 == part}
        assert len(tested) == len(poses) == 5
        shown = {each.identifier for each in Humans().entries if each.subject not in tested and each.pose not in poses}
        taught = {f"{subject}_{CANONICAL_POSE}" for subject in SUBJECTS if subject not in tested}
        assert set(card["identifiers"]) == shown | taught
        assert card["pairs"] == len(shown)


@pytest.mark.parametrize("of_data", ["(tosca|animals)-III.*"], indirect=True)
def test_neither_cat_nor_horse_is_seen_by_a_model_of_table_3(of_data: list[Card]) -> None:
    for card in of_data:
        assert not [name for name in card["identifiers"] if re.match("cat|horse", name)]
        assert not {"cat", "horse"} & set(card["subjects"])


@pytest.mark.parametrize("of_data", ["humans-(sampled|varied)"], indirect=True)
def test_streams_are_none_of_the_data_sets(of_data: list[Card]) -> None:
    for card in of_data:
        assert not set(card["subjects"]) & {*SUBJECTS, *adults()}
        assert card["extra_data"]


@pytest.mark.parametrize("of_data", ["animals-sampled"], indirect=True)
def test_sampled_animals_are_of_no_set(of_data: list[Card]) -> None:
    """They are rendered in the frame of the generated set, so no file of TOSCA is read; and each is redrawn."""
    assert find_training("animals-sampled").dataset == "animals"
    shown = {entry.identifier for entry in Animals().entries} | {entry.subject for entry in Animals().entries}
    for card in of_data:
        assert not shown & {*card["identifiers"], *card["subjects"]}
        assert card["extra_data"]
    number = max(len(card["subjects"]) for card in of_data) // 2
    for place in range(number):
        written = SPECIES[SPECIES_IN_TURN[place % len(SPECIES_IN_TURN)]]
        redrawn = drawn_species(written, np.random.default_rng([synthetic.SEED, place, 0]))
        girths = [
            np.log(after.sections[0].depth / before.sections[0].depth)
            for before, after in zip(written.tubes, redrawn.tubes, strict=True)
        ]
        assert np.abs(girths).max() > 0.05, "some part is thicker or thinner by more than a twentieth"
        body = varied_body(np.random.default_rng([synthetic.SEED, place * synthetic.MOST_DRAWS**2, 0]))
        assert clearance(body.subject, AWAY_FROM) >= 0.25


def test_no_body_that_was_trained_on_has_the_phenotype_of_a_tested_one(cards: dict[Path, Card]) -> None:
    """Names say little: what a body is lies in its phenotype. Neighbouring subjects of one set are .3 apart or more."""
    tested = np.array([astuple(human_subjects.SUBJECTS[name]) for name in SUBJECTS])
    between = np.linalg.norm(tested[:, None] - tested, axis=2)
    assert between[~np.eye(len(tested), dtype=bool)].min() > 0.3, "a fold's subjects and those of its training"
    for card in cards.values():
        if card["data"].startswith(("humans-fold", "humans-strict")):
            bodies = [human_subjects.SUBJECTS[name] for name in card["subjects"]]
            assert card["clearance"] == clearances(bodies), card["data"]
        if card["data"] in ("humans-varied", "animals-sampled"):
            assert card["clearance"] == dict.fromkeys(AWAY_FROM, 0.25)
        if card["data"] == "humans-sampled":
            assert card["clearance"] == dict.fromkeys(human_subjects.TESTED, 0.25)
    drawn = [varied_body(np.random.default_rng([0, number, 0])).subject for number in range(1500)]
    assert min(clearance(subject, AWAY_FROM) for subject in drawn) >= 0.25


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
    assert record["models"][0]["digest"] == card["digest"][:16]
    # Three poses of five subjects: random order finds a shape of the subject first in a seventh of the queries.
    assert record["scores"]["NN"] > 2 * record["chance"]["NN"]
    assert "128 x 128 pixels, 60 epochs" in done.stdout


def test_a_cat_is_doubted_by_the_network_of_people_and_a_person_is_not() -> None:
    fits = []
    for dataset in (Animals(), Humans()):
        preparation = Preparation(dataset, "view", None)
        fits.append(StreamedLearner().measure_fit(preparation.shape(dataset.entries[0])))
    cat, person = fits
    assert cat["outline_blur"] > StreamedLearner.usual_blur > person["outline_blur"]
    assert ("doubt" in cat, "doubt" in person) == (True, False)

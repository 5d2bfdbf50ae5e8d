"""The models that come with the project: whole, small, and trained on nothing that they are tested
on.
"""

from __future__ import annotations

import re
from dataclasses import astuple

import numpy as np

from benchmark.api.contracts import Shape
from benchmark.api.datasets import ShapeSet
from benchmark.api.learning import CARD, digest_of, read_card
from benchmark.datasets.animals import animals
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.people import CLEARANCE, PEOPLE, clearances, people
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.views import prepare_view
from benchmark.protocols.trainings import SUBJECT_FOLDS
from learned.images import resampled
from learned.methods import Learned, Streamed
from learned.models import NetworkCard, average_body, load_model

MEBIBYTES, ALL_MEBIBYTES = 20, 150
CARDS = {
    path.parent: read_card(path.parent, NetworkCard)
    for path in sorted(Learned.shipped_models.glob(f"*/*/{CARD}"))
}
SUBJECTS = PEOPLE[0]
NAMES = list(SUBJECTS)


def cards_of(pattern: str) -> list[NetworkCard]:
    """Cards of the models whose training has a name that matches."""
    matching = [card for folder, card in CARDS.items() if re.fullmatch(pattern, folder.parent.name)]
    assert matching, f"no model is shipped that was trained on {pattern}"
    return matching


def test_every_model_is_the_one_that_its_card_describes() -> None:
    for folder, card in CARDS.items():
        load_model(folder)
        assert folder.parent.name == card.data
        assert folder.name.startswith(f"{card.configuration.name}-seed")
        assert max(path.stat().st_size for path in folder.iterdir()) <= MEBIBYTES * 2**20
    assert (
        sum(path.stat().st_size for path in Learned.shipped_models.rglob("*"))
        <= ALL_MEBIBYTES * 2**20
    )


def test_a_model_of_a_fold_has_seen_all_other_subjects_and_is_for_those_of_the_fold() -> None:
    for card in cards_of("people-fold-[012]"):
        tested = {NAMES[place] for place in SUBJECT_FOLDS[int(card.data[-1])]}
        assert card.subjects == set(NAMES) - tested
        assert card.tested == digest_of(tested)
        assert len(card.identifiers) == 200


def test_neither_cat_nor_horse_is_seen_by_a_model_of_table_3() -> None:
    for card in cards_of("(tosca|animals)-III.*"):
        assert not [name for name in card.identifiers if re.match("cat|horse", name)]
        assert not {"cat", "horse"} & card.subjects


def test_no_body_that_was_trained_on_has_the_phenotype_of_a_tested_one() -> None:
    """Names say little: what a body is lies in its phenotype."""
    for card in cards_of("people-fold.*"):
        bodies = [SUBJECTS[name] for name in card.subjects]
        tested = np.array(
            [astuple(body) for name, body in SUBJECTS.items() if name not in card.subjects]
        )
        nearest = min(np.linalg.norm(tested - astuple(body), axis=1).min() for body in bodies)
        assert nearest >= card.clearance["people[draw=0]"] >= CLEARANCE, card.data
        assert (
            card.clearance["humans-scanlike"] == clearances(bodies)["humans-scanlike"] >= CLEARANCE
        ), card.data


def test_the_average_body_of_a_fold_is_that_of_its_training() -> None:
    shapes = people()
    assert shapes.half_width
    trained = [
        each
        for each in canonical_shapes(shapes).values()
        if NAMES.index(each.subject) not in SUBJECT_FOLDS[1]
    ]
    views = [
        prepare_view(shapes.load(each), shapes.camera(each), shapes.half_width)["depth"]
        for each in trained
    ]
    depth, mask = np.stack([resampled(view, 128) for view in views]).astype(float).swapaxes(0, 1)
    covered = mask.any(axis=0)
    mean = (depth.sum(axis=0) / mask.sum(axis=0).clip(1))[covered]
    np.testing.assert_allclose(
        average_body(Learned.shipped_models / "people-fold-1" / "literal-seed0", 128).numpy()[
            covered
        ],
        mean,
        atol=4e-5,
    )


def seen(dataset: ShapeSet) -> Shape:
    """The first shape of a data set as a depth camera sees it."""
    entry = dataset.shapes[0]
    assert dataset.half_width
    return shape_of(
        prepare_view(dataset.load(entry), dataset.camera(entry), dataset.half_width),
        entry.identifier,
    )


def test_a_cat_is_doubted_by_the_network_of_people_and_a_person_is_not() -> None:
    cat, person = (
        Streamed().canonicalise(seen(dataset)).notes for dataset in (animals(), people())
    )
    assert cat["outline_blur"] > Streamed.usual_blur > person["outline_blur"]
    assert ("doubt" in cat, "doubt" in person) == (True, False)

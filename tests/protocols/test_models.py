"""Which shipped model may be tested on which set: names of subjects, and how near its bodies come
to them.
"""

from __future__ import annotations

import re
from contextlib import nullcontext
from pathlib import Path

import pytest

from benchmark.api.datasets import Entry
from benchmark.api.learning import CARD, Card, digest_of, read_card
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.protocols.models import MissingModel, Model, TooNear, find_models, with_model
from benchmark.protocols.trainings import TRAININGS, trainings_by_shape
from benchmark.registry import select_one
from learned.methods import Learned, TrainedNetwork

GENERATED = "people[n=4]"
CHANGED = [
    "people[noise=3]",
    "people[jitter=1]",
    "people[depth-noise=2][jitter=1]",
    "animals-few[noise=1]",
    "people[draw=1][holes=2]",
    "humans-scanlike[holes=1]",
    f"{GENERATED}[noise=1]",
]
SETS = [*(name for name, source in CATALOGUE.items() if not source.folder), GENERATED, *CHANGED]


def shipped() -> list[Model]:
    folders = (path.parent for path in sorted(Learned.shipped_models.glob(f"*/*/{CARD}")))
    return [Model(folder.parent.name, folder, read_card(folder)) for folder in folders]


def refused(model: Model, name: str) -> bool:
    try:
        model.check(name, None)
    except TooNear:
        return True
    return False


def refused_on(training: str) -> set[str]:
    """Sets that the models of a training must not be tested on."""
    if training == "humans-sampled":  # apart from people, too
        return {name for name in SETS if name.startswith(("animals", GENERATED))}
    if training in ("humans-varied", "animals-sampled"):
        return {name for name in SETS if name.startswith(("animals", "people", GENERATED))}
    if training.startswith("people"):  # draws are not kept apart
        near = (
            ("people[draw=2]",)
            if training.startswith(("people-fold-2", "people-strict-2"))
            else ("people[draw=1]", "people[draw=2]")
        )
        return {name for name in SETS if name.startswith(near)}
    return set()


def share_seen(training: str, name: str) -> float:
    """Share of the subjects of a set that the models of a training have seen."""
    if training.startswith(("people-fold", "people-strict")):
        is_first_draw = name.startswith("people") and not re.match(r"people\[(draw=[12]|n=)", name)
        return 2 / 3 if is_first_draw else 0.0
    if training == "animals-III" and name.startswith("animals"):
        return 4 / 9 if name == "animals" else 1 / 6
    return 0.0


def test_every_pair_of_a_shipped_model_and_a_generated_set() -> None:
    models = shipped()
    assert len({model.training for model in models}) >= 7
    subjects = {name: [(e, e.subject) for e in open_dataset(name, None).shapes] for name in SETS}
    for model in models:
        assert {name for name in SETS if refused(model, name)} == refused_on(model.training), (
            model.folder
        )
        for name, shapes in subjects.items():
            seen = {subject for entry, subject in shapes if model.has_seen(entry, name)}
            expected = share_seen(model.training, name) * len({subject for _, subject in shapes})
            assert len(seen) == pytest.approx(expected), f"{model.folder} on {name}"


@pytest.mark.parametrize("name", ["people[noise=3]", "animals-few"])
def test_a_changed_set_is_treated_by_models_that_have_not_seen_its_subjects(name: str) -> None:
    dataset = open_dataset(name, None)
    of_shape = trainings_by_shape(Learned(), dataset, dataset.shapes, None)
    trainings = {
        model.training: model for model in shipped() if model.folder.name == "literal-seed0"
    }
    seen = [
        e.identifier
        for e in dataset.shapes
        if trainings[of_shape[e.identifier].name].has_seen(e, name)
    ]
    assert len(of_shape) == len(dataset.shapes)
    # The paper tests on animals that it trained on, too.
    assert seen == (["dog0", "dog2", "dog4"] if name == "animals-few" else [])


def model_with(training: str, **card: object) -> Model:
    facts = {
        "digest": "0" * 64,
        "data": training,
        "subjects": frozenset("a"),
        "identifiers": frozenset("a"),
        **card,
    }
    return Model(training, Path(), Card(**facts))  # type: ignore[arg-type]


def test_a_card_that_says_nothing_of_a_set_is_refused_there_if_its_bodies_were_generated() -> None:
    assert refused(model_with("humans-sampled"), "people")
    assert not refused(model_with("people-fold-0"), "humans-scanlike")
    assert not refused(model_with("humans-sampled"), "tosca")
    assert refused(
        model_with("people-fold-0", clearance={"humans-scanlike": 0.2}), "humans-scanlike"
    )
    people = model_with("people-fold-0", clearance={"people[draw=0]": 0.3, "people[draw=1]": 0.2})
    assert [refused(people, f"people[draw={draw}]") for draw in (0, 1)] == [False, True]


def test_a_model_for_other_subjects_is_refused() -> None:
    for tested, fits in ((digest_of(["man-1"]), False), ("", True)):
        model = model_with("people-fold-0", tested=tested)
        with (
            nullcontext()
            if fits
            else pytest.raises(MissingModel, match="was trained for other test subjects; train")
        ):
            model.check("people[draw=0]", None)


def test_partial_shapes_of_tosca_are_seen_by_models_trained_on_it() -> None:
    dog = Entry("cuts_dog_shape_1", "dog", "1")
    model = model_with("tosca-III", identifiers=frozenset({"dog0"}), subjects=frozenset({"dog"}))
    assert (
        model.has_seen(dog, "shrec16-cuts")
        and model.has_seen(dog, "tosca")
        and not model.has_seen(dog, "animals")
    )


@pytest.mark.parametrize(
    "method",
    [
        "learned",
        "learned-wide-extra",
        "learned-wide-extra[training=animals-sampled]",
        "learned-streamed",
        "deformation-field",
    ],
)
def test_a_missing_model_that_cannot_be_trained_any_more_is_only_fetched(
    method, monkeypatch, tmp_path
):
    component = select_one(method)
    learner = component.create()
    training = learner.training or learner.default_training
    monkeypatch.setattr(TrainedNetwork, "shipped_models", tmp_path)
    with pytest.raises(MissingModel) as raised:
        with_model(component)
    hint = raised.value.hint
    assert f"run `python -m benchmark models fetch {training} --from" in hint
    is_trained = "run `python -m benchmark train " in hint
    assert is_trained != TRAININGS[training].is_frozen
    assert is_trained != ("train at commit 4868b8b9" in hint)


def test_a_model_of_own_data_has_seen_subjects_of_the_same_name_in_any_set() -> None:
    ben = Entry("ben/1", "ben", "1")
    model = model_with("own-scans", identifiers=frozenset(), subjects=frozenset({"ben"}))
    for dataset in ("people[draw=0]", "tosca", "a folder"):
        assert model.has_seen(ben, dataset), dataset
    assert not model.has_seen(Entry("ann/1", "ann", "1"), "tosca")


@pytest.mark.parametrize("training", ["people-fold-1", "own-x"])
def test_a_missing_model_of_a_network_that_comes_trained_names_the_commit(training) -> None:
    shapes = open_dataset(GENERATED)
    method = select_one(f"learned-streamed[training={training}]")
    with pytest.raises(MissingModel, match=f"needs the model {training}; train at commit"):
        find_models(method, shapes, shapes.shapes[:2], None, None)


def test_a_missing_model_of_own_data_is_trained_on_a_folder():
    shapes = open_dataset(GENERATED)
    method = select_one("learned[training=own-colleagues]")
    with pytest.raises(MissingModel, match=r"--data FOLDER --hold-out SUBJECT -o resolution=128"):
        find_models(method, shapes, shapes.shapes[:2], None, None)

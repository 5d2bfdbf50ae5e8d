"""Which shapes train which model, by hand."""

from types import SimpleNamespace

import pytest

from benchmark.datasets.animals import animals
from benchmark.datasets.base import Part, canonical_shapes
from benchmark.datasets.people import people
from benchmark.errors import ConfigurationError
from benchmark.protocols import trainings
from benchmark.protocols.galleries import galleries
from benchmark.protocols.trainings import TRAININGS, trainings_by_shape
from learned.methods import Learned, Strict

SETS = {"people[draw=0]": people(), "animals": animals()}
FOLDS = [f"people-fold-{a}" for a in range(3)]
STRICT = [f"people-strict-{a}-{b}" for a in range(3) for b in range(4)]
GENERATED = [
    name
    for name, training in TRAININGS.items()
    if training.dataset in SETS and training.trained != Part()
]


def shown(name):
    """Identifiers and subjects of inputs and targets."""
    training = TRAININGS[name]
    dataset = SETS[training.dataset]
    inputs = training.trained.of(dataset)
    return inputs, {
        canonical_shapes(dataset)[subject] for subject in {entry.subject for entry in inputs}
    }


def unseen_of(name):
    return TRAININGS[name].tested.of(SETS[TRAININGS[name].dataset])


@pytest.mark.parametrize(
    ("name", "pairs", "subjects", "unseen"),
    [(name, 200, 10, 100) for name in FOLDS]
    + [("animals-III", 22, 4, 19)]
    + [(name, 150, 10, 25) for name in STRICT],
)
def test_numbers_of_pairs(name, pairs, subjects, unseen):
    inputs, _ = shown(name)
    assert (len(inputs), len({entry.subject for entry in inputs}), len(unseen_of(name))) == (
        pairs,
        subjects,
        unseen,
    )


@pytest.mark.parametrize("name", GENERATED)
def test_what_is_tested_is_never_trained_on(name):
    inputs, targets = shown(name)
    assert not {e.subject for e in (*inputs, *targets)} & {e.subject for e in unseen_of(name)}


@pytest.mark.parametrize("name", STRICT)
def test_strict_trainings_see_no_pose_of_the_test_but_the_canonical_one_as_target(name):
    inputs, targets = shown(name)
    fold = {entry.pose for entry in unseen_of(name)}
    assert len(fold) == 5
    assert not fold & {entry.pose for entry in inputs}
    canonical = {people().shapes[0].pose}
    assert {entry.pose for entry in targets} == canonical
    assert bool(targets - set(inputs)) == bool(canonical & fold) == name.endswith("-0")


@pytest.mark.parametrize("names", [FOLDS, STRICT])
def test_the_folds_test_every_shape_once(names):
    chosen = [entry.identifier for name in names for entry in unseen_of(name)]
    assert len(chosen) == len(set(chosen)) == 300


@pytest.mark.parametrize("learner", [Learned(), Strict()])
def test_no_shape_of_a_gallery_meets_a_model_that_knows_its_subject(learner):
    for gallery in galleries(["I", "IV"]):
        if gallery.inputs == ("mesh",):
            continue
        models = trainings_by_shape(learner, gallery.dataset, gallery.entries, None)
        assert list(models) == [entry.identifier for entry in gallery.entries]
        known = {
            training.name: {e.subject for part in shown(training.name) for e in part}
            for training in set(models.values())
        }
        assert not any(
            entry.subject in known[models[entry.identifier].name] for entry in gallery.entries
        )


def test_each_gallery_gets_the_models_of_its_table():
    def names(learner, gallery):
        found = trainings_by_shape(learner, gallery.dataset, gallery.entries, gallery.data_root)
        return {training.name for training in found.values()}

    sampled = SimpleNamespace(split="sampled")
    found = {gallery.name: gallery for gallery in galleries(["I", "II", "III"])}
    folds = [found[f"people[draw=0] fold {fold}"] for fold in range(3)]
    assert [names(Learned(), gallery) for gallery in folds] == [{name} for name in FOLDS]
    assert names(Learned(), found["people[draw=0]"]) == {*FOLDS}
    second, third = found["humans-scanlike"], found["animals"]
    assert [names(Learned(), gallery) for gallery in (second, third)] == [
        {"people-fold-0"},
        {"animals-III"},
    ]
    assert {name for gallery in (*folds, second) for name in names(sampled, gallery)} == {
        "humans-sampled"
    }
    assert names(Learned(training="people-fold-1"), third) == {"people-fold-1"}
    assert names(Strict(), folds[2]) == {f"people-strict-2-{b}" for b in range(4)}
    with pytest.raises(
        ConfigurationError, match="'humans-scanlike' has no folds of subjects and poses"
    ):
        names(Strict(), second)
    with pytest.raises(
        ConfigurationError, match="unknown training 'people-fold-3'; did you mean people-fold"
    ):
        names(Learned(training="people-fold-3"), folds[0])


@pytest.mark.parametrize("present", [True, False])
def test_official_scans_get_the_network_of_the_official_people_where_these_are(
    present, monkeypatch
):
    monkeypatch.setattr(
        trainings, "is_present", lambda name, root: present and name == "shrec14-synthetic"
    )
    names = [
        trainings._trainings_for(Learned(), name, None)[0].name
        for name in ("shrec14-real", "humans-scanlike")
    ]
    assert names == ["shrec14-synthetic-fold-0" if present else "people-fold-0", "people-fold-0"]

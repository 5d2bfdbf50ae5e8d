"""Pairs as a learner gets them, on a toy set of fifteen subjects in twenty poses."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from benchmark.api.datasets import FRONT, Entry, ShapeSet
from benchmark.api.learning import digest_of
from benchmark.datasets.base import Part
from benchmark.errors import ConfigurationError, InvalidMesh
from benchmark.pipeline.views import prepare_view
from benchmark.protocols.pairs import data_of_training
from benchmark.protocols.trainings import TRAININGS
from tests.toy import rod


def rods(broken="", name="people[draw=0]", canonical_poses=None):
    """Rods of fifteen widths, bent in twenty ways; one of them cannot be read."""

    def load(entry):
        if entry.identifier == broken:
            raise InvalidMesh("a hole", "correct it")
        subject, pose = map(int, entry.identifier.split("-"))
        return rod(0.1 + 0.01 * subject, 0.1 * pose, rings=8, sides=8)

    return ShapeSet(
        name=name,
        shapes=tuple(Entry(f"{s}-{p}", f"s{s}", f"p{p}") for s in range(15) for p in range(20)),
        load=load,
        key=lambda entry: f"rod {entry.identifier} {broken}",
        half_width=2.0,
        canonical_poses=canonical_poses or {},
    )


def made(monkeypatch, name, dataset=None, say=None, **part):
    monkeypatch.setattr("benchmark.protocols.pairs.open_dataset", lambda *_: dataset or rods())
    training = replace(TRAININGS[name], **part)
    return data_of_training(training, None, say or (lambda _: None))


def test_pairs_show_a_shape_and_its_subject_in_the_canonical_pose(monkeypatch):
    data = made(
        monkeypatch, "people-fold-2", trained=Part((0, 3), (0, 1, 2)), tested=Part((12,), (0, 5))
    )
    got = list(data.pairs())
    assert [(pair.identifier, pair.target_identifier, pair.subject) for pair in got] == [
        (f"{subject}-{pose}", f"{subject}-0", f"s{subject}")
        for subject in (0, 3)
        for pose in range(3)
    ]
    assert data.n_pairs == 6
    assert data.subjects == ("s0", "s3")
    assert set(data.identifiers) == {pair.identifier for pair in got}
    assert [pair.identifier for pair in data.validation()] == ["12-0", "12-5"]
    assert np.array_equal(got[0].image, got[0].target)
    assert np.array_equal(got[0].image, got[2].target)
    assert not np.array_equal(got[0].image, got[1].image)
    assert [pair.identifier for pair in data.pairs()] == [pair.identifier for pair in got]
    assert data.tested == digest_of(["s12"])
    assert data.n_validation == 2


def test_images_are_those_that_methods_are_given(monkeypatch):
    data = made(monkeypatch, "people-fold-2", trained=Part((0,), (1,)))
    (pair,) = data.pairs()
    dataset = rods()
    seen = prepare_view(dataset.load(dataset.shapes[1]), FRONT, 2.0)
    assert np.array_equal(pair.image, seen["depth"])
    assert 0 == pair.image.min() < pair.image.max() <= 1


def test_in_a_strict_training_the_canonical_pose_of_the_fold_is_target_alone(monkeypatch):
    first = made(monkeypatch, "people-strict-1-0", trained=Part((5, 6), (5, 6)))
    assert [pair.identifier for pair in first.pairs()] == ["5-5", "5-6", "6-5", "6-6"]
    assert set(first.identifiers) == {"5-0", "5-5", "5-6", "6-0", "6-5", "6-6"}


def test_a_shape_that_cannot_be_rendered_is_left_out_and_told(monkeypatch):
    said = []
    data = made(
        monkeypatch, "people-fold-2", rods(broken="1-1"), said.append, trained=Part((0, 1), (0, 1))
    )
    assert [pair.identifier for pair in data.pairs()] == ["0-0", "0-1", "1-0"]
    assert said == ["skipped 1-1: a hole; correct it"]
    without_target = made(
        monkeypatch, "people-fold-2", rods(broken="1-0"), trained=Part((0, 1), (0, 1))
    )
    assert [pair.identifier for pair in without_target.pairs()] == ["0-0", "0-1"]


def test_training_on_what_is_tested_is_refused(monkeypatch):
    with pytest.raises(ConfigurationError, match="would include test subjects of its models: s9"):
        made(monkeypatch, "people-fold-2", trained=Part((8, 9), (0,)), tested=Part((9, 10), (0,)))
    with pytest.raises(ConfigurationError, match="'people-fold-2' has no pairs"):
        made(monkeypatch, "people-fold-2", trained=Part((77,)))


def test_trainings_on_people_are_validated_on_new_ones_and_name_their_distance_from_each_draw():
    data = data_of_training(TRAININGS["people-fold-0"], None, print)
    assert (data.n_pairs, data.n_validation) == (200, 40)
    pair = next(data.validation())
    assert pair.subject == "body-12" and pair.image.any()
    assert data.clearance["people[draw=0]"] >= 0.25 > data.clearance["people[draw=1]"]
    assert set(data.clearance) == {
        "humans",
        "humans-scanlike",
        *(f"people[draw={draw}]" for draw in range(3)),
    }


def test_random_people_are_kept_apart_from_tested_ones_and_from_the_judges():
    data = data_of_training(TRAININGS["humans-sampled"], None, print)
    assert (data.n_pairs, data.n_validation) == (70_000, 40)
    assert data.clearance == dict.fromkeys(
        ("humans", "humans-scanlike", "people", "people[n=12]"), 0.25
    )
    assert data.bodies is not None and len(data.bodies.names) == 10_000
    assert data.extra_data and not data.tested
    first, second = islice(data.pairs(), 2)
    assert (first.identifier, second.identifier) == ("sample-0_0", "sample-0_1")
    assert np.array_equal(first.image, first.target)
    assert np.array_equal(second.target, first.target)
    assert not np.array_equal(second.image, first.image)


@pytest.mark.parametrize("name", ["animals-sampled", "humans-varied"])
def test_frozen_trainings_name_the_commit_that_has_their_generator(name):
    with pytest.raises(ConfigurationError, match="not generated any more; .* commit 4868b8b9"):
        data_of_training(TRAININGS[name], None, print)

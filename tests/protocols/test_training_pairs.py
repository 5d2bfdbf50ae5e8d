"""Pairs as a learner gets them, on a toy set of fifteen subjects in twenty poses."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from benchmark.datasets import humans
from benchmark.datasets.base import Entry, Part
from benchmark.errors import ConfigurationError, InvalidMesh
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import render_depth
from benchmark.pipeline.method_run import Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.protocols.pairs import synthetic, training_data
from benchmark.protocols.trainings import TRAININGS
from tests.toy import rod


@dataclass(frozen=True)
class Rods:
    """Rods of fifteen widths, bent in twenty ways; one of them cannot be read."""

    name: str = "humans"
    title: str = "rods"
    stand_in_for: str = ""
    half_width: float = 2.0
    broken: str = ""

    @property
    def entries(self):
        return tuple(Entry(f"{s}-{p}", f"s{s}", f"p{p}") for s in range(15) for p in range(20))

    def load(self, entry):
        if entry.identifier == self.broken:
            raise InvalidMesh("a hole", "correct it")
        subject, pose = map(int, entry.identifier.split("-"))
        return rod(0.1 + 0.01 * subject, 0.1 * pose, rings=8, sides=8)

    def recipe(self, entry):
        return f"rod {entry.identifier} {self.broken}"

    def camera(self, entry):
        return FRONT


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path)


def made(monkeypatch, store, name, dataset=None, say=None, **part):
    monkeypatch.setattr("benchmark.protocols.pairs.open_dataset", lambda *_: dataset or Rods())
    training = replace(TRAININGS[name], **part)
    return training_data(training, store, None, say or (lambda _: None))


def test_pairs_show_a_shape_and_its_subject_in_the_canonical_pose(monkeypatch, store):
    data = made(monkeypatch, store, "humans-fold-2", trained=Part((0, 3), (0, 1, 2)), tested=Part((12,), (0, 5)))
    got = list(data.pairs())
    assert [(pair.identifier, pair.target_identifier, pair.subject) for pair in got] == [
        (f"{subject}-{pose}", f"{subject}-0", f"s{subject}") for subject in (0, 3) for pose in range(3)
    ]
    assert data.n_pairs == 6
    assert data.subjects == ("s0", "s3")
    assert set(data.identifiers) == {pair.identifier for pair in got}
    assert [pair.identifier for pair in data.unseen()] == ["12-0", "12-5"]
    assert np.array_equal(got[0].image, got[0].target)
    assert np.array_equal(got[0].image, got[2].target)
    assert not np.array_equal(got[0].image, got[1].image)
    assert [pair.identifier for pair in data.pairs()] == [pair.identifier for pair in got]
    later = list(data.pairs(2))
    assert [pair.identifier for pair in later] == ["0-2", "3-0", "3-1", "3-2"]
    assert np.array_equal(later[0].target, got[0].image)
    assert [pair.identifier for pair in data.unseen(1)] == ["12-5"]


def test_images_are_those_that_methods_are_given(monkeypatch, store):
    data = made(monkeypatch, store, "humans-fold-2", trained=Part((0,), (1,)))
    (pair,) = data.pairs()
    rods = Rods()
    preparation = Preparation(rods, "view", store)
    assert preparation.artefact(rods.entries[1]).was_cached
    assert np.array_equal(pair.image, preparation.shape(rods.entries[1]).depth)
    assert pair.image.shape == (500, 500)
    assert pair.image.dtype == np.float32
    assert 0 == pair.image.min() < pair.image.max() <= 1


def test_in_a_strict_training_the_canonical_pose_of_the_fold_is_target_alone(monkeypatch, store):
    first = made(monkeypatch, store, "humans-strict-1-0", trained=Part((5, 6), (5, 6)))
    assert [pair.identifier for pair in first.pairs()] == ["5-5", "5-6", "6-5", "6-6"]
    assert set(first.identifiers) == {"5-0", "5-5", "5-6", "6-0", "6-5", "6-6"}


def test_a_shape_that_cannot_be_rendered_is_left_out_and_told(monkeypatch, store):
    said = []
    data = made(monkeypatch, store, "humans-fold-2", Rods(broken="1-1"), said.append, trained=Part((0, 1), (0, 1)))
    assert [pair.identifier for pair in data.pairs()] == ["0-0", "0-1", "1-0"]
    assert data.n_pairs == 3
    assert said == ["skipped 1-1: a hole; correct it"]
    without_target = made(monkeypatch, store, "humans-fold-2", Rods(broken="1-0"), trained=Part((0, 1), (0, 1)))
    assert [pair.identifier for pair in without_target.pairs()] == ["0-0", "0-1"]


def test_the_digest_names_the_shapes_and_their_recipes(monkeypatch, store):
    def digest(dataset=None, **part):
        return made(monkeypatch, store, "humans-fold-2", dataset, **part).digest

    one = digest(trained=Part((0,), (0, 1)))
    assert one == digest(trained=Part((0,), (0, 1)))
    assert one != digest(trained=Part((0,), (0, 2)))
    assert one != digest(Rods(half_width=2.5), trained=Part((0,), (0, 1)))
    assert one != digest(Rods(broken="9-9"), trained=Part((0,), (0, 1)))  # another recipe of every shape


def test_training_on_what_is_tested_is_refused(monkeypatch, store):
    with pytest.raises(ConfigurationError, match="would include test shapes of its models: s9, 9-0"):
        made(monkeypatch, store, "humans-fold-2", trained=Part((8, 9), (0,)), tested=Part((9, 10), (0,)))
    with pytest.raises(ConfigurationError, match="'humans-fold-2' has no pairs"):
        made(monkeypatch, store, "humans-fold-2", trained=Part((77,)))


def test_sampled_bodies_stream_in_the_frame_of_the_data_set(store):
    data = training_data(TRAININGS["humans-sampled"], store, None, lambda _: None, n_sampled=2)
    got = list(data.pairs())
    assert data.n_pairs == len(got) == len(data.identifiers) == 2 * 7
    assert [pair.subject for pair in got] == ["sample-0"] * 7 + ["sample-1"] * 7
    assert {pair.target_identifier for pair in got} == {"sample-0_0", "sample-1_0"}
    assert np.array_equal(got[7].image, got[13].target)
    (body, poses), _ = humans.sample_humans(2, 6, seed=0)
    expected = render_depth(humans.human_mesh(body, poses[2]), FRONT, humans.Humans().half_width)
    assert np.array_equal(got[3].image, expected)
    larger = training_data(TRAININGS["humans-sampled"], store, None, lambda _: None, n_sampled=3)
    assert data.digest != larger.digest
    assert data.identifiers == larger.identifiers[:14]
    assert not set(data.subjects) & {entry.subject for entry in humans.Humans().entries}


def test_a_sampled_body_that_leaves_the_frame_is_drawn_again_and_told(monkeypatch, store):
    first, again = humans.sample_human(1, 6, seed=0), humans.sample_human(1, 6, seed=0, draw=1)
    assert first[0] != again[0]
    leaving = {1: [humans.human_mesh(*pose_of(first, place)) for place in range(7)]}
    monkeypatch.setattr(
        synthetic, "_leaves_frame", lambda mesh, *_: any(np.array_equal(mesh.vertices, m.vertices) for m in leaving[1])
    )
    said = []
    data = training_data(TRAININGS["humans-sampled"], store, None, said.append, n_sampled=3)
    got = list(data.pairs())
    assert said == ["sample-1 leaves the frame and is drawn again (1 so far)"]
    assert [pair.identifier for pair in got] == list(data.identifiers)
    expected = render_depth(humans.human_mesh(*pose_of(again, 4)), FRONT, humans.Humans().half_width)
    assert np.array_equal(got[7 + 4].image, expected)
    assert np.array_equal(next(iter(data.pairs(11))).image, expected)


def pose_of(sample, place):
    body, poses = sample
    return body, (humans.POSES[humans.CANONICAL_POSE], *poses)[place]

"""Random people for training: far from all tested ones, and the same everywhere."""

from dataclasses import astuple
from hashlib import sha256

import numpy as np

from benchmark.datasets import sampled
from benchmark.datasets.bodies import POSES
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.people import CLEARANCE, JUDGES, N_JUDGES, _phenotypes, clearances
from benchmark.datasets.sampled import N_SHAPES, sampled_body, sampled_images
from learned.images import resampled


def test_bodies_keep_their_distance_from_all_tested_people_and_from_the_judges():
    bodies = [sampled_body(number)[0] for number in range(300)]
    assert min(clearances(bodies, sampled.AWAY_FROM).values()) >= CLEARANCE
    assert JUDGES in sampled.AWAY_FROM
    judges = {entry.subject for entry in open_dataset(JUDGES).shapes}
    assert len(judges) == len(_phenotypes(JUDGES)) == N_JUDGES
    assert {round(body.gender) for body in bodies[::3]} == {0}
    assert len({astuple(body) for body in bodies}) == 300


def test_a_body_depends_on_its_number_and_draw_alone():
    first, poses = sampled_body(7)
    again, same = sampled_body(7)
    assert first == again and np.array_equal(poses, same)
    other, others = sampled_body(7, draw=1)
    assert other != first and not np.array_equal(poses[1:], others[1:])
    assert len(poses) == N_SHAPES and np.array_equal(poses[0], POSES["standing"])


def test_random_poses_bend_no_arm_further_than_an_authored_one():
    poses = np.concatenate([sampled_body(number)[1] for number in range(50)])
    authored = np.stack(list(POSES.values()))
    ends = np.concatenate([authored[:, 0:4], authored[:, 4:8]])
    for arm in (poses[:, 0:4], poses[:, 4:8]):
        assert (arm >= ends.min(axis=0) - 1e-9).all()
        assert (arm <= ends.max(axis=0) + 1e-9).all()


def test_a_body_that_leaves_the_frame_is_drawn_again(monkeypatch):
    draws = []
    meshes = sampled._meshes

    def told(number, draw):
        draws.append(draw)
        return meshes(number, draw)

    monkeypatch.setattr(sampled, "_meshes", told)
    monkeypatch.setattr(sampled, "_leaves_frame", lambda mesh, width: len(draws) < 3)
    assert len(list(sampled_images(0, 1.285))) == N_SHAPES
    assert draws == [0, 1, 2]


def test_images_are_the_same_everywhere():
    half_width = open_dataset("people[draw=0]").half_width
    images = [resampled(image, 128)[0] for image in sampled_images(0, half_width)]
    kept = np.stack(images) - 0.5
    digest = sha256(kept.astype(np.float16).tobytes()).hexdigest()
    assert digest == "474287cfb539a1636a42c612c2d357b600af0eb35d5677af64cdb4dc59c43d3e"

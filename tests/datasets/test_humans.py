"""The generated humans: plausible, different, posed as said, and the same everywhere."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import astuple, replace

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from benchmark.datasets import humans
from benchmark.datasets.human_poses import POSES, Column
from benchmark.datasets.human_subjects import PEOPLE, SUBJECTS, adults
from benchmark.datasets.humans import Humans, human_meshes, recipe, sample_humans
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh


def made(*subjects: str) -> list[Mesh]:
    """The subjects in every pose."""
    return list(human_meshes((SUBJECTS[name], pose) for name in subjects for pose in POSES.values()))


@pytest.mark.slow
def test_another_process_with_two_threads_makes_the_same_shapes() -> None:
    program = (
        "import torch; from benchmark.datasets.humans import Humans; import hashlib\n"
        "data = Humans(); print(hashlib.sha256(b''.join("
        "data.load(data.entries[row]).vertices.tobytes() for row in (3, 250))).hexdigest())"
    )
    environment = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "2")
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    data = Humans()
    here = b"".join(data.load(data.entries[row]).vertices.tobytes() for row in (3, 250))
    assert run.stdout.split()[-1] == hashlib.sha256(here).hexdigest()


@pytest.mark.parametrize("subjects", [["man-2"], pytest.param([*SUBJECTS], marks=pytest.mark.exhaustive)])
def test_poses_differ_fit_the_frame_and_push_no_body_through_itself(subjects: list[str]) -> None:
    import pymeshlab

    meshes = made(*subjects)
    assert 0.5 < fit_half_width(meshes, FRONT) <= Humans().half_width
    for mesh in meshes:
        layers = pymeshlab.MeshSet()
        layers.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
        layers.compute_selection_by_self_intersections_per_face()
        # Creases of knees and groin; an arm through the chest takes more than three per cent.
        assert layers.current_mesh().face_selection_array().mean() < 0.015
        view = depth_surface(mesh, FRONT, Humans().half_width)
        assert 1000 < view.surface.n_vertices < 3200
        assert view.report.lost_samples < 0.05 * view.surface.n_vertices
    if len(subjects) == len(SUBJECTS):
        assert Humans().half_width == pytest.approx(fit_half_width(meshes, FRONT), rel=0.002)
    poses = np.array(
        [((mesh.vertices - mesh.vertices.mean(axis=0)) / np.sqrt(mesh.area)).ravel() for mesh in meshes[:20]]
    )
    assert pdist(poses).min() / np.sqrt(meshes[0].n_vertices) > 0.08


def test_a_recipe_names_body_and_pose_without_making_them() -> None:
    data = Humans()
    recipes = {data.recipe(entry) for entry in data.entries}
    assert len(recipes) == 300
    man, pose = SUBJECTS["man-1"], POSES["walking"]
    assert recipe(man, pose) in recipes
    assert recipe(replace(man, weight=0.16), pose) not in recipes
    assert recipe(man, replace(pose, head=Column(turn=1))) not in recipes


def test_importing_and_listing_loads_nothing_heavy() -> None:
    program = (
        "import sys; from benchmark.datasets.humans import Humans; data = Humans(); data.recipe(data.entries[0])\n"
        "print([name for name in ('torch', 'anny', 'warp') if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize("package", ["anny", "torch"])
def test_a_missing_package_says_what_to_install(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(DatasetError, match=f"package '{package}'.*pip install {package}"):
        humans._body.__wrapped__()


def test_sampled_subjects_are_none_that_methods_are_tested_on() -> None:
    sets = (SUBJECTS, adults(), *PEOPLE)
    taken = np.array([astuple(subject) for subjects in sets for subject in subjects.values()])
    assert len(taken) == 100
    sampled = np.array([astuple(subject) for subject, _ in sample_humans(200, 0, seed=1)])
    assert np.linalg.norm(sampled[:, None] - taken[None], axis=2).min() >= 0.25
    assert sampled.min() >= 0
    assert sampled.max() <= 1
    children = sampled[:, 1] < 0.5
    assert 0.2 < children.mean() < 0.5
    assert len(np.unique(sampled, axis=0)) == 200


def test_a_sample_depends_on_its_seed_and_grows_at_the_end() -> None:
    small, large, other = sample_humans(3, 2, seed=5), sample_humans(5, 4, seed=5), sample_humans(3, 2, seed=6)
    assert [subject for subject, _ in small] == [subject for subject, _ in large[:3]]
    assert [list(poses) for _, poses in small] == [list(poses[:2]) for _, poses in large[:3]]
    assert all(mine[0] != theirs[0] for mine, theirs in zip(small, other, strict=True))

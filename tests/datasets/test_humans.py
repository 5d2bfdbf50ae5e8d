"""The generated humans: plausible, different, posed as said, and the same everywhere."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import subprocess
import sys
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from benchmark.datasets import humans
from benchmark.datasets.base import Dataset, Entry, check_retrievable
from benchmark.datasets.human_poses import POSES, Arm, Column, Leg, Pose, bone_rotations
from benchmark.datasets.human_subjects import RANDOM_SUBJECTS, SUBJECTS, adults
from benchmark.datasets.humans import Humans, human_mesh, human_meshes, recipe, sample_humans
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh

LEFT, FORWARD, UP = np.eye(3) * [[1], [-1], [1]]


@pytest.fixture(scope="module")
def meshes() -> list[Mesh]:
    return list(human_meshes((subject, pose) for subject in SUBJECTS.values() for pose in POSES.values()))


@pytest.fixture(scope="module")
def unit_area(meshes: list[Mesh]) -> NDArray[np.float64]:
    """Centred vertices of unit area, shape (15, 20, n, 3)."""
    stack = np.stack([(mesh.vertices - mesh.vertices.mean(axis=0)) / np.sqrt(mesh.area) for mesh in meshes])
    return stack.reshape(len(SUBJECTS), len(POSES), -1, 3)


def differences(shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean square distances of corresponding vertices, shape (k, k)."""
    flat = shapes.reshape(len(shapes), -1)
    squared = (flat**2).sum(axis=1)
    product = squared[:, None] + squared[None] - 2 * flat @ flat.T
    return np.sqrt(np.maximum(product, 0) / shapes.shape[-2])


def smallest(matrix: NDArray[np.float64]) -> float:
    return float((matrix + np.diag(np.full(len(matrix), np.inf))).min())


def digest(mesh: Mesh) -> str:
    # Tenths of a millimetre: a value within rounding error (1e-15 m) of a boundary has odds of about 1 in 10^6.
    quantised = np.floor(mesh.vertices * 1e4 + 0.5 + 1e-3).astype("<i4")
    return hashlib.sha256(quantised.tobytes() + mesh.faces.astype("<i4").tobytes()).hexdigest()[:16]


def shape(subject: str, pose: str) -> Mesh:
    return human_mesh(SUBJECTS[subject], POSES[pose])


def pose_with(**parts: Arm | Leg | Column) -> dict[str, NDArray[np.float64]]:
    return bone_rotations(Pose(**parts))  # type: ignore[arg-type]


def test_is_a_data_set_of_fifteen_by_twenty() -> None:
    data: Dataset = Humans()
    assert data.stand_in_for == "shrec14-synthetic"
    assert len(data.entries) == len({entry.identifier for entry in data.entries}) == 300
    assert [entry.subject for entry in data.entries[::20]] == list(SUBJECTS)
    assert [entry.pose for entry in data.entries[:20]] == list(POSES)
    assert humans.CANONICAL_POSE == data.entries[0].pose == "standing"
    assert data.camera(data.entries[0]) == FRONT
    check_retrievable(data)


def test_men_women_and_children_are_in_training_and_in_test() -> None:
    kinds = [name.split("-")[0] for name in SUBJECTS]
    assert sorted(kinds) == ["child"] * 5 + ["man"] * 5 + ["woman"] * 5
    assert set(kinds[:10]) == set(kinds[10:]) == {"man", "woman", "child"}
    for kind, subject in zip(kinds, SUBJECTS.values(), strict=True):
        assert (subject.age < 0.5) == (kind == "child")
        assert kind == "child" or subject.gender == (kind == "woman")
        assert all(0 <= value <= 1 for value in astuple(subject))


@pytest.mark.parametrize("name", POSES)
def test_a_pose_is_rotations_of_anatomical_angles(name: str) -> None:
    pose = POSES[name]
    for rotation in bone_rotations(pose).values():
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
    for limb in (pose.left_arm, pose.right_arm, pose.left_leg, pose.right_leg):
        assert 0 <= limb.bend <= 150
    assert Pose.from_angles(pose.angles()) == pose
    assert pose.mirrored().mirrored() == pose


def test_a_mirrored_pose_has_mirrored_rotations() -> None:
    mirror = np.diag([-1.0, 1.0, 1.0])
    swapped = {"L": "R", "R": "L"}
    rotations, mirrored = bone_rotations(POSES["throwing"]), bone_rotations(POSES["throwing"].mirrored())
    for bone, rotation in rotations.items():
        stem, dot, side = bone.partition(".")
        np.testing.assert_allclose(mirrored[stem + dot + swapped.get(side, "")], mirror @ rotation @ mirror, atol=1e-12)


@pytest.mark.parametrize(
    ("arm", "upper", "fore"),
    [
        (Arm(raised=0, bend=0), -UP, -UP),
        (Arm(raised=90, bend=0), LEFT, LEFT),
        (Arm(raised=180, bend=0), UP, UP),
        (Arm(raised=90, forward=90, bend=0), FORWARD, FORWARD),
        (Arm(raised=90, forward=-90, bend=0), -FORWARD, -FORWARD),
        (Arm(raised=90, bend=90), LEFT, FORWARD),
        (Arm(raised=90, roll=90, bend=90), LEFT, UP),
        (Arm(raised=0, bend=90), -UP, FORWARD),
    ],
)
def test_an_arm_points_where_its_angles_say(arm: Arm, upper: NDArray[np.float64], fore: NDArray[np.float64]) -> None:
    rotations = pose_with(left_arm=arm)
    shoulder = rotations["clavicle.L"] @ rotations["upperarm01.L"] @ rotations["upperarm02.L"]
    rest_upper, rest_fore = np.array([0.664, -0.021, -0.747]), np.array([0.512, -0.687, -0.517])
    np.testing.assert_allclose(shoulder @ rest_upper, upper, atol=2e-3)
    # The forearm at rest is not quite bent to the front, so neither is the bent one: within 12 degrees.
    assert (shoulder @ rotations["lowerarm01.L"] @ rest_fore) @ fore > np.cos(np.radians(12))


@pytest.mark.parametrize(
    ("leg", "thigh", "shank", "toes"),
    [
        (Leg(flexion=90, abduction=0, roll=0, bend=90), FORWARD, -UP, FORWARD),
        (Leg(flexion=0, abduction=0, roll=0, bend=90), -UP, -FORWARD, -UP),
        (Leg(flexion=0, abduction=90, roll=0, bend=0), LEFT, LEFT, FORWARD),
        (Leg(flexion=0, abduction=0, roll=90, bend=0), -UP, -UP, LEFT),
        (Leg(flexion=0, abduction=0, roll=0, bend=0, point=90), -UP, -UP, -UP),
    ],
)
def test_a_leg_points_where_its_angles_say(
    leg: Leg, thigh: NDArray[np.float64], shank: NDArray[np.float64], toes: NDArray[np.float64]
) -> None:
    rotations = pose_with(left_leg=leg)
    hip = rotations["upperleg01.L"] @ rotations["upperleg02.L"]
    knee = hip @ rotations["lowerleg01.L"]
    np.testing.assert_allclose(hip @ -UP, thigh, atol=1e-12)
    np.testing.assert_allclose(knee @ -UP, shank, atol=1e-12)
    np.testing.assert_allclose(knee @ rotations["foot.L"] @ FORWARD, toes, atol=1e-12)


def test_the_trunk_bends_leans_and_turns() -> None:
    def chest(column: Column) -> NDArray[np.float64]:
        return np.linalg.matrix_power(pose_with(trunk=column)["spine03"], 5)

    np.testing.assert_allclose(chest(Column(bend=90)) @ UP, FORWARD, atol=1e-12)
    np.testing.assert_allclose(chest(Column(lean=90)) @ UP, LEFT, atol=1e-12)
    np.testing.assert_allclose(chest(Column(turn=90)) @ FORWARD, LEFT, atol=1e-12)


def test_a_body_is_one_closed_surface_of_genus_zero() -> None:
    mesh = shape("woman-2", "sitting")
    assert (mesh.n_vertices, mesh.n_faces) == (13348, 26692)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.euler_number == 2
    assert solid.body_count == 1
    assert 0.02 < solid.volume < 0.2


def test_a_standing_body_faces_the_front_camera() -> None:
    mesh = shape("man-1", "standing")
    width, thickness, height = np.ptp(mesh.vertices, axis=0)
    assert height > width > thickness
    feet = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 0.05 * height]
    shins = mesh.vertices[np.abs(mesh.vertices[:, 2] - mesh.vertices[:, 2].min() - 0.15 * height) < 0.02 * height]
    assert feet[:, 1].min() < shins[:, 1].min() - 0.05 * height


def test_the_same_shape_whatever_is_made_with_it(meshes: list[Mesh]) -> None:
    for row in (0, 7, 133, 299):
        entry = Humans().entries[row]
        np.testing.assert_array_equal(Humans().load(entry).vertices, meshes[row].vertices)


def test_golden_shapes() -> None:
    golden = {
        ("man-1", "standing"): "02ff082e3c1a08f6",
        ("woman-3", "throwing"): "d5a4c8d12bf9a6ec",
        ("child-5", "crouching"): "9280501f75f0a53e",
    }
    assert {key: digest(shape(*key)) for key in golden} == golden


@pytest.mark.slow
@pytest.mark.parametrize("threads", ["1", "2"])
def test_other_processes_and_thread_counts_make_the_same_shapes(threads: str) -> None:
    program = (
        "import torch; from benchmark.datasets.humans import Humans; import hashlib\n"
        "data = Humans(); print(hashlib.sha256(b''.join("
        "data.load(data.entries[row]).vertices.tobytes() for row in (3, 250))).hexdigest())"
    )
    environment = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), threads)
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    data = Humans()
    here = b"".join(data.load(data.entries[row]).vertices.tobytes() for row in (3, 250))
    assert run.stdout.split()[-1] == hashlib.sha256(here).hexdigest()


def test_all_shapes_fit_the_declared_frame(meshes: list[Mesh]) -> None:
    assert Humans().half_width == pytest.approx(fit_half_width(meshes, FRONT), rel=0.002)
    assert Humans().half_width >= fit_half_width(meshes, FRONT)


def test_bodies_differ_with_and_without_their_size(meshes: list[Mesh], unit_area: NDArray[np.float64]) -> None:
    standing = np.stack([mesh.vertices - mesh.vertices.mean(axis=0) for mesh in meshes[::20]])
    assert smallest(differences(standing)) > 0.012  # metres
    matrix = differences(unit_area[:, 0])
    assert smallest(matrix) > 0.015
    assert 0.03 < np.median(matrix[matrix > 0]) < 0.05
    assert matrix.max() > 0.08


def test_pose_dominates_the_raw_similarity(unit_area: NDArray[np.float64]) -> None:
    matrix = differences(unit_area.reshape(300, -1, 3))
    np.fill_diagonal(matrix, np.inf)
    nearest = matrix.argmin(axis=1)
    assert (nearest // 20 == np.arange(300) // 20).mean() <= 0.05
    assert (nearest % 20 == np.arange(300) % 20).mean() >= 0.9


def test_every_pose_is_different(unit_area: NDArray[np.float64]) -> None:
    for subject in unit_area:
        assert smallest(differences(subject)) > 0.08


@pytest.mark.parametrize("subject", ["man-2", pytest.param("all", marks=pytest.mark.exhaustive)])
def test_no_pose_pushes_a_body_through_itself(meshes: list[Mesh], subject: str) -> None:
    import pymeshlab

    names = list(SUBJECTS)
    rows = range(300) if subject == "all" else range(names.index(subject) * 20, names.index(subject) * 20 + 20)
    for row in rows:
        layers = pymeshlab.MeshSet()
        layers.add_mesh(pymeshlab.Mesh(meshes[row].vertices, meshes[row].faces))
        layers.compute_selection_by_self_intersections_per_face()
        share = layers.current_mesh().face_selection_array().mean()
        # Creases of knees and groin; an arm through the chest takes more than three per cent.
        assert share < 0.015, Humans().entries[row].identifier


def test_a_view_of_every_pose_has_no_lost_limb(meshes: list[Mesh]) -> None:
    for mesh in meshes[60:80]:
        view = depth_surface(mesh, FRONT, Humans().half_width)
        assert 1000 < view.surface.n_vertices < 3200
        assert view.report.lost_samples < 0.05 * view.surface.n_vertices
        extent, seen = (np.ptp(m.vertices, axis=0) for m in (mesh, view.surface))
        np.testing.assert_allclose(
            seen[:2], extent[[0, 2]], atol=0.15
        )  # fingers of both hands can be narrower than a sample


def test_a_recipe_names_body_and_pose_without_making_them() -> None:
    data = Humans()
    recipes = {data.recipe(entry) for entry in data.entries}
    assert len(recipes) == 300
    man, pose = SUBJECTS["man-1"], POSES["walking"]
    assert recipe(man, pose) in recipes
    assert recipe(replace(man, weight=0.16), pose) not in recipes
    assert recipe(man, replace(pose, head=Column(turn=1))) not in recipes


def test_a_recipe_holds_parameters_alone() -> None:
    told = recipe(SUBJECTS["man-1"], POSES["standing"])
    assert told.startswith("body [0.0, 0.89, 0.26, 0.43, 0.24, 0.81] with joints [")
    values = [float(word) for word in re.sub(r"body|with|joints|[\[\],]", " ", told).split()]
    assert values[6:] == POSES["standing"].angles().tolist()


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


def test_the_first_use_says_that_it_takes_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import anny.paths

    class Built(Exception):
        pass

    class Anny:
        def __init__(self, **_: object) -> None:
            raise Built

    monkeypatch.setattr(anny, "Anny", Anny)
    monkeypatch.setattr(anny.paths, "_ANNY_CACHE_DIR", [tmp_path])
    with pytest.raises(Built):
        humans._body.__wrapped__()
    assert capsys.readouterr().err.count("\n") == 1
    (tmp_path / "v1").mkdir()
    (tmp_path / "v1" / "cached").touch()
    with pytest.raises(Built):
        humans._body.__wrapped__()
    assert capsys.readouterr().err == ""


def test_sampled_subjects_are_none_that_methods_are_tested_on() -> None:
    sets = (SUBJECTS, adults(), *RANDOM_SUBJECTS)
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


def test_sampled_poses_stay_within_the_joints_of_authored_ones() -> None:
    authored = np.stack([end.angles() for pose in POSES.values() for end in (pose, pose.mirrored())])
    sampled = np.stack([pose.angles() for _, poses in sample_humans(20, 10, seed=2) for pose in poses])
    assert (sampled >= authored.min(axis=0) - 1e-9).all()
    assert (sampled <= authored.max(axis=0) + 1e-9).all()
    assert np.abs(sampled[:, None] - authored[None]).max(axis=2).min() > 1


def test_sampled_shapes_fit_the_frame() -> None:
    pairs = [(subject, pose) for subject, poses in sample_humans(10, 4, seed=3) for pose in poses]
    made = list(human_meshes(pairs))
    assert len(made) == 40
    assert fit_half_width(made, FRONT, fill=0.99) <= Humans().half_width


def test_meshes_come_as_they_are_asked_for() -> None:
    endless = human_meshes(itertools.repeat((SUBJECTS["man-1"], POSES["standing"])))
    assert next(endless).n_vertices == next(endless).n_vertices
    assert list(human_meshes([])) == []
    assert Entry("man-1_standing", "man-1", "standing") == Humans().entries[0]

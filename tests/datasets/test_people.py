"""The generated people: plausible, different, posed as said, and the same everywhere."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from benchmark.datasets.bodies import POSES, Subject, bone_rotations, jittered, mirrored_pose
from benchmark.datasets.bodies import SUBJECTS as SETS
from benchmark.datasets.catalogue import is_known, open_dataset
from benchmark.datasets.official import SETS as OFFICIAL
from benchmark.datasets.people import PEOPLE, _scan, new_subject, people

TAKEN = np.array(
    [astuple(body) for name in SETS if name != "animals" for body in SETS[name].values()]
)
OTHERS = np.array(
    [astuple(body) for name in ("humans", "humans-scanlike") for body in SETS[name].values()]
)


def test_sets_have_the_same_poses_and_names_of_their_own() -> None:
    names = [*(f"people[draw={draw}]" for draw in range(3)), "people[n=4]"]
    sets = [open_dataset(name) for name in names]
    assert [data.name for data in sets] == names
    assert [len(data.shapes) for data in sets] == [300] * 3 + [80]
    assert all(
        [e.pose for e in data.shapes] == [*POSES] * (len(data.shapes) // 20) for data in sets
    )
    subjects = [{entry.subject for entry in data.shapes} for data in sets]
    assert len(set().union(*subjects)) == sum(map(len, subjects)) == 49
    assert len({data.key(entry) for data in sets for entry in data.shapes}) == 980
    assert open_dataset("people").name == "people[draw=0]"
    assert is_known("people[n=10][noise=2]") and not is_known("people[n=5")


def drawn_subjects(draw: int) -> dict[str, Subject]:
    """Draw man, woman and child in turn, five times; a letter names the draw.

    Every value is uniform in its range and rounded to two digits; a child is male or female. Bodies
    nearer than 0.25 to a subject of ``humans`` or ``humans-scanlike`` are redrawn. There are no
    other constraints, in particular none on distances between the subjects. The seed is the date of
    the draw."""
    random = np.random.Generator(np.random.PCG64([20261124, draw]))
    drawn: dict[str, Subject] = {}
    for number in range(1, 6):
        for kind, ages in (("man", (0.60, 1.0)), ("woman", (0.60, 1.0)), ("child", (0.26, 0.48))):
            # Gender, age, muscle, weight, height and proportions.
            lowest, highest = np.array(
                [(0, 1), ages, (0.15, 0.95), (0.14, 0.95), (0.08, 0.60), (0.12, 0.95)]
            ).T
            name = f"{kind}-{'abc'[draw]}{number}"
            while name not in drawn:
                values = np.round(lowest + random.random(6) * (highest - lowest), 2)
                values[0] = {"man": 0.0, "woman": 1.0, "child": float(values[0] >= 0.5)}[kind]
                if np.linalg.norm(OTHERS - values, axis=1).min() >= 0.25:
                    drawn[name] = Subject(*values.tolist())
    return drawn


@pytest.mark.parametrize("draw", range(3))
def test_the_committed_people_are_those_that_the_rule_draws_apart_from_the_others(
    draw: int,
) -> None:
    assert PEOPLE[draw] == drawn_subjects(draw)
    drawn = np.array([astuple(subject) for subject in PEOPLE[draw].values()])
    distances = np.linalg.norm(drawn[:, None] - OTHERS, axis=2)
    assert distances.min() >= 0.25
    assert np.abs(distances - 0.25).min() > 1e-9, "no draw hangs on the last bits of a distance"


def test_further_bodies_keep_away_from_tested_ones_and_a_larger_set_begins_with_the_smaller() -> (
    None
):
    small, large = open_dataset("people[n=3]"), open_dataset("people[n=200]")
    keys = [large.key(entry) for entry in large.shapes[:60]]
    assert [small.key(entry) for entry in small.shapes] == keys
    bodies = np.array(
        [astuple(new_subject(np.random.default_rng([1, n]), n % 3)) for n in range(200)]
    )
    assert np.linalg.norm(bodies[:, None] - TAKEN, axis=2).min() >= 0.25
    assert bodies.min() >= 0 and bodies.max() <= 1
    assert (bodies[:, 1] < 0.5).sum() == 66
    assert len(np.unique(bodies, axis=0)) == 200
    assert str(np.round(bodies[1], 9).tolist()) in large.key(large.shapes[20])


def test_a_mirrored_pose_turns_the_other_bones_and_a_jittered_one_stays_within_the_joints() -> None:
    for pose in POSES.values():
        np.testing.assert_array_equal(mirrored_pose(mirrored_pose(pose)), pose)
    bones, other = (
        bone_rotations(POSES["throwing"]),
        bone_rotations(mirrored_pose(POSES["throwing"])),
    )
    sign = np.diag([-1.0, 1.0, 1.0])
    for bone, rotation in bones.items():
        twin = (
            {"L": bone[:-1] + "R", "R": bone[:-1] + "L"}.get(bone[-1], bone)
            if "." in bone
            else bone
        )
        np.testing.assert_allclose(sign @ rotation @ sign, other[twin], atol=1e-12)
    ends = np.array([end for pose in POSES.values() for end in (pose, mirrored_pose(pose))])
    moved = np.array([jittered(pose, 30.0, np.random.default_rng(0)) for pose in POSES.values()])
    assert (moved >= ends.min(axis=0)).all() and (moved <= ends.max(axis=0)).all()
    assert np.abs(moved - [*POSES.values()]).max() > 10


def test_cameras_around_a_scan_see_one_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    _scan.cache_clear()
    simulated: list[str] = []
    monkeypatch.setattr(
        "benchmark.datasets.scanning.scanned", lambda _, __, name: simulated.append(name)
    )
    shapes = open_dataset("humans-scanlike[cameras=12]")
    for entry in shapes.shapes[:24]:
        shapes.load(entry)
    _scan.cache_clear()
    assert simulated == ["man-1_standing", "man-1_walking"]


def test_surfaces_without_size_get_the_mean_area_of_the_adults():
    shapes = people()
    standing = [entry for entry in shapes.shapes if entry.pose == "standing"]
    areas = [shapes.load(of).area for of in standing if not of.subject.startswith("child")]
    assert len(areas) == 10
    assert np.mean(areas) == pytest.approx(1.79, abs=0.005)
    (copy,) = OFFICIAL["faust"].copies
    assert copy.area == round(np.mean(areas), 1)
    assert OFFICIAL["faust"].half_width == shapes.half_width

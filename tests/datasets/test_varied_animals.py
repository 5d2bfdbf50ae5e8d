"""Animals of random proportions: whole, of one piece in every pose, and what the numbers say when chance is silent."""

import igl
import numpy as np
import pytest

from benchmark.datasets.animals.anatomy import Species, tube
from benchmark.datasets.animals.generate import SPECIES
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.datasets.varied_animals import SPECIES_IN_TURN, AnimalSampler, motion, proportions, sampler
from benchmark.errors import DatasetError, InvalidMesh


class Silent:
    """A source of chance that always gives the middle."""

    def normal(self, size=None):
        return np.zeros(size) if size else 0.0

    def uniform(self):
        return 0.5

    def integers(self, _):
        return 0


class Told(Silent):
    """A source of chance that says what it was told, then the middle."""

    def __init__(self, *values):
        self.values = list(values)

    def normal(self, size=None):
        return self.values.pop(0) if self.values and not size else super().normal(size)


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Make bodies of fewer triangles, in less time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampler, "N_VERTICES", 1500)
        yield


@pytest.fixture(scope="module")
def animals():
    """One animal of each species in two poses beside the rest pose."""
    return [AnimalSampler(7, 2)(number) for number in range(len(SPECIES_IN_TURN))]


def test_every_species_has_its_turn(animals):
    assert [name for name, _ in animals] == list(SPECIES_IN_TURN) == list(SPECIES)


def test_an_animal_is_closed_and_of_one_piece_and_has_one_set_of_triangles(animals):
    for _, meshes in animals:
        assert len(meshes) == 3
        mesh = meshes[0]
        edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
        assert igl.connected_components(igl.adjacency_matrix(mesh.faces.astype(np.int64)))[0] == 1
        for other in meshes:
            assert np.array_equal(other.faces, mesh.faces)
            assert np.isfinite(other.vertices).all()


def test_a_pose_bends_and_hardly_stretches(animals):
    for name, (rest, *moved) in animals:
        a, b, _ = rest.faces.T
        length = np.linalg.norm(rest.vertices[a] - rest.vertices[b], axis=1)
        for mesh in moved:
            now = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
            assert np.median(np.abs(now / length - 1.0)) < 0.05, name
            assert np.abs(mesh.area / rest.area - 1.0) < 0.1, name
            assert np.abs(mesh.vertices - rest.vertices).max() > 5.0, name


def test_an_animal_is_a_function_of_its_number_and_of_how_often_it_was_drawn():
    made = AnimalSampler(7, 1)
    (_, first), (_, same), (_, again), (_, next_cat) = made(0), made(0), made(0, 1), made(6)
    assert np.array_equal(first[1].vertices, same[1].vertices)
    sizes = {tuple(np.ptp(meshes[0].vertices, axis=0).round(3)) for meshes in (first, again, next_cat)}
    assert len(sizes) == 3, "three animals"


def test_silent_chance_gives_the_species_as_it_is_written_down():
    for species in SPECIES.values():
        redrawn = proportions.drawn_species(species, Silent())
        for before, after in zip(species.tubes, redrawn.tubes, strict=True):
            assert (after.part, after.parent, after.paired) == (before.part, before.parent, before.paired)
            assert [section.bone for section in after.sections] == [section.bone for section in before.sections]
            np.testing.assert_allclose(
                [section[1:] for section in after.sections], [section[1:] for section in before.sections], atol=1e-9
            )


TOY = Species(
    "toy",
    (
        tube("trunk", "", ("pelvis", 0, 100, 0, 5, 6), ("", 40, 100, 0, 5, 6), blend=4),
        tube("neck", "pelvis", ("neck", 40, 100, 0, 4, 4), ("", 50, 120, 0, 4, 4), blend=2),
        tube("nose", "neck", ("", 50, 120, 0, 1, 2), ("", 60, 120, 0, 1, 2), blend=1),
        tube("hind", "pelvis", ("thigh", 0, 90, 5, 3, 3), ("", 0, 0, 5, 3, 3), blend=2, paired=True),
    ),
)


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        # Size, forward, side, up, legs, girth; then length (of a chain that hangs) and girth of each tube in turn.
        ((1,), {"trunk": (0, 100, 0, 5, 6), "nose_end": (60, 120, 0, 1, 2), "foot": (0, 0, 5, 3, 3), "by": "SIZE"}),
        ((0, 1), {"trunk": (0, 100, 0, 5, 6), "nose_end": (66.31, 120, 0, 1, 2), "foot": (0, 0, 5, 3, 3)}),
        # Legs below 70 per cent of the pelvis grow, the rest is lifted: 100 + 70 (e^.1 - 1).
        ((0, 0, 0, 0, 1), {"trunk": (0, 107.36, 0, 5, 6), "nose_end": (60, 127.36, 0, 1, 2), "foot": (0, 0, 5, 3, 3)}),
        # The neck, longer by e^.1 about (40, 100), carries the nose along, larger: 40 + 20 e^.1, 100 + 20 e^.1.
        (
            (0, 0, 0, 0, 0, 0, 0, 1),
            {"trunk": (0, 100, 0, 5, 6), "nose_end": (62.1, 122.1, 0, 1.11, 2.21), "foot": (0, 0, 5, 3, 3)},
        ),
    ],
)
def test_proportions_worked_by_hand(told, expected):
    trunk, _, nose, hind = proportions.drawn_species(TOY, Told(*told)).tubes
    scale = np.exp(0.08) if expected.pop("by", "") else 1.0
    got = {"trunk": trunk.sections[0], "nose_end": nose.sections[-1], "foot": hind.sections[-1]}
    for name, values in expected.items():
        np.testing.assert_allclose(got[name][1:], scale * np.array(values), atol=0.01, err_msg=name)


def test_feet_stay_on_the_ground_and_factors_within_their_bounds():
    for number in range(50):
        random = np.random.default_rng(number)
        redrawn = proportions.drawn_species(SPECIES["horse"], random)
        (hind,) = (part for part in redrawn.tubes if part.part == "hind")
        assert hind.sections[-1].up == 0.0
        factors = [
            after.sections[0].depth / before.sections[0].depth
            for before, after in zip(SPECIES["horse"].tubes, redrawn.tubes, strict=True)
        ]
        assert max(np.abs(np.log(factors))) <= 2 * (0.08 + 0.10 + 0.10 + 3 * 0.10) + 1e-9


def test_between_a_pose_and_itself_lies_that_pose(monkeypatch):
    species = SPECIES["cat"]
    skeleton = Skeleton.of(species)
    monkeypatch.setattr(motion, "JITTER", 0.0)
    for pose in POSES["cat"].values():
        monkeypatch.setattr(motion, "LIBRARY", {"cat": (pose,)})
        rotations, translations = motion.drawn_motion(skeleton, "cat", np.random.default_rng(0))
        expected, moved = skeleton.transforms(pose)
        np.testing.assert_allclose(rotations.as_matrix(), expected.as_matrix(), atol=1e-9)
        np.testing.assert_allclose(translations, moved, atol=1e-7)


def test_halfway_between_two_poses_a_joint_has_turned_by_half(monkeypatch):
    species = SPECIES["gorilla"]
    skeleton = Skeleton.of(species)
    bone = skeleton.index("forearm.left")
    poses = iter((0, 1))

    class Halfway(Silent):
        def integers(self, _):
            return next(poses)

    monkeypatch.setattr(motion, "LIBRARY", {"gorilla": ({}, {"arm.left": (None, None, (90, 0))})})
    rotations, _ = motion.drawn_motion(skeleton, "gorilla", Halfway())
    whole, _ = skeleton.transforms({"arm.left": (None, None, (90, 0))})
    assert rotations[bone].magnitude() == pytest.approx(whole[bone].magnitude() / 2, abs=1e-9)


def test_poses_are_shared_by_all_species_with_the_same_bones():
    for name in SPECIES:
        chains = {part.partition(".")[0] for part in Skeleton.of(SPECIES[name]).chains}
        assert len(motion.LIBRARY[name]) >= len(POSES[name])
        own = [pose for pose in motion.LIBRARY[name] if pose not in POSES[name].values()]
        assert all({part.partition(".")[0] for part in pose} <= chains | {"neck", "head"} for pose in own)


def test_a_body_with_a_hole_is_drawn_again_and_one_without_end_is_an_error(monkeypatch):
    calls = []
    whole = sampler.surface

    def broken_first(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise InvalidMesh("a handle", "correct it")
        return whole(*arguments)

    monkeypatch.setattr(sampler, "surface", broken_first)
    name, meshes = AnimalSampler(7, 0)(2)
    assert (name, len(meshes), len(calls)) == ("dog", 1, 2)

    def never(*_):
        raise InvalidMesh("a handle", "correct it")

    monkeypatch.setattr(sampler, "surface", never)
    with pytest.raises(DatasetError, match="animal 2 of sample 7 has no closed body"):
        AnimalSampler(7, 0)(2)

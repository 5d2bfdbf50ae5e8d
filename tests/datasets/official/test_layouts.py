"""Official sets in their layouts: shapes, labels, order, cameras and canonical poses."""

from collections import Counter

import pytest

from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.official import SETS, _sets, members_digest
from benchmark.geometry.camera import FRONT, SIDE, Camera
from tests.datasets.official.layouts import LISTED, NAMED

SIZES = [
    ("shrec14-synthetic", 300, 15, 20, ("219", "10", "19")),
    ("shrec14-real", 400, 40, 10, ("399", "39", "9")),
    ("shrec07", 400, 20, 20, ("386", "fourleg", "5")),
    ("shrec10", 200, 10, 20, ("T13", "official-class1", "T13")),
    ("shrec11", 600, 30, 20, ("T599", "official-class23", "T599")),
    ("shrec12-generic", 1200, 60, 20, ("D00061", "class7", "D00061")),
    ("shrec15", 1200, 50, 24, ("T1200", "class0", "T1200")),
    ("shrec15-canonical", 100, 10, 10, ("9", "class3", "9")),
    ("shrec16-cuts", 24, 8, 3, ("cuts_dog_shape_2", "dog", "2")),
    ("shrec16-holes", 24, 8, 3, ("holes_wolf_shape_3", "wolf", "3")),
    ("faust", 100, 10, 10, ("tr_reg_037", "3", "7")),
    ("kids", 32, 2, 16, ("0002.isometry.11", "0002", "11")),
    ("topkids", 26, 1, 26, ("kid25", "kid", "25")),
    ("scape", 71, 1, 71, ("mesh071", "scape", "71")),
]


def test_every_set_is_tested():
    assert [name for name, *_ in SIZES] == [name for name in SETS if name != "tosca"]
    assert {*NAMED, *LISTED} == set(SETS) - {"tosca"}


@pytest.mark.parametrize(("name", "n_shapes", "n_classes", "n_poses", "example"), SIZES)
def test_a_set_in_its_layout_has_its_shapes_and_labels(sets, name, n_shapes, n_classes, n_poses, example):
    dataset = open_dataset(name, sets)
    sizes = Counter(entry.subject for entry in dataset.shapes)
    assert (len(dataset.shapes), len(sizes), set(sizes.values())) == (n_shapes, n_classes, {n_poses})
    assert len({entry.identifier for entry in dataset.shapes}) == len({e.path for e in dataset.shapes}) == n_shapes
    (entry,) = [entry for entry in dataset.shapes if entry.identifier == example[0]]
    assert (entry.subject, entry.pose) == example[1:]
    assert entry.path.stem == example[0]
    assert dataset.load(entry).n_faces == 4
    known = CATALOGUE[name]
    assert (known.n_shapes or n_shapes, known.n_classes) == (n_shapes, n_classes)


def test_the_digests_are_those_of_the_official_lists():
    members = {name: _sets()[name].members for name in ("shrec10", "shrec11")}
    # Two classes of each list, as the tracks gave them out.
    crabs = (49, 15, 154, 83, 144, 26, 181, 139, 56, 82, 161, 9, 3, 187, 166, 156, 68, 162, 128, 19)
    teddy = (134, 54, 40, 185, 35, 105, 199, 13, 36, 137, 100, 46, 106, 130, 118, 29, 34, 10, 107, 33)
    assert [members["shrec10"][members_digest(numbers)] for numbers in (crabs, teddy)] == ["crabs", "teddy"]
    alien = (137, 30, 50, 124, 290, 5, 422, 545, 411, 9, 511, 311, 31, 547, 418, 573, 220, 133, 18, 228)
    woman = (345, 581, 22, 147, 503, 585, 586, 461, 89, 294, 521, 332, 592, 381, 395, 238, 410, 36, 580, 534)
    assert [members["shrec11"][members_digest(numbers)] for numbers in (alien, woman)] == ["alien", "woman"]
    assert (len(members["shrec10"]), len(members["shrec11"])) == (10, 30)


def test_cameras(sets):
    up = {name: open_dataset(name, sets) for name in ("faust", "shrec16-cuts", "shrec11")}
    assert up["faust"].camera(up["faust"].shapes[0]) == Camera((0, 0, -1), (0, 1, 0))
    cuts = {entry.subject: up["shrec16-cuts"].camera(entry) for entry in up["shrec16-cuts"].shapes}
    assert (cuts["horse"], cuts["david"]) == (SIDE, FRONT)
    assert up["shrec11"].camera(up["shrec11"].shapes[0]) == FRONT


def test_saying_that_faust_stands_along_y_changes_nothing(sets, damaged):
    folder = damaged("faust")
    (folder / "dataset.toml").write_text('up = "y"\ncanonical_pose = 3\n')
    dataset = open_dataset("faust", folder.parent)
    assert dataset.camera(dataset.shapes[0]) == Camera((0, 0, -1), (0, 1, 0))
    assert canonical_shapes(dataset)["2"].identifier == "tr_reg_023"
    (folder / "dataset.toml").write_text('camera = "side"\nup = "y"\n')
    dataset = open_dataset("faust", folder.parent)
    assert dataset.camera(dataset.shapes[0]) == Camera((1, 0, 0), (0, 1, 0))


def test_canonical_poses_are_the_null_shapes(sets):
    for name, subject, identifier in (
        ("kids", "0002", "0002.null.0"),
        ("topkids", "kid", "kid00"),
        ("shrec14-real", "3", "30"),
    ):
        assert canonical_shapes(open_dataset(name, sets))[subject].identifier == identifier

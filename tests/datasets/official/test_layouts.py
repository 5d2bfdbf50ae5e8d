"""Official sets in their layouts, or absent: shapes, labels, order, cameras, canonical poses, and
their table.
"""

from collections import Counter

import pytest

from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.official import _FACTS, EXTENDED, SETS, members_digest
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.protocols.galleries import galleries
from tests.datasets.official.layouts import LISTED, NAMED, make

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
def test_a_set_in_its_layout_has_its_shapes_and_labels(
    sets, name, n_shapes, n_classes, n_poses, example
):
    dataset = open_dataset(name, sets)
    sizes = Counter(entry.subject for entry in dataset.shapes)
    assert (len(dataset.shapes), len(sizes), set(sizes.values())) == (
        n_shapes,
        n_classes,
        {n_poses},
    )
    assert (
        len({entry.identifier for entry in dataset.shapes})
        == len({e.path for e in dataset.shapes})
        == n_shapes
    )
    (entry,) = [entry for entry in dataset.shapes if entry.identifier == example[0]]
    assert (entry.subject, entry.pose) == example[1:]
    assert entry.path.stem == example[0]
    assert dataset.load(entry).n_faces == 4
    known = CATALOGUE[name]
    assert (known.n_shapes or n_shapes, known.n_classes) == (n_shapes, n_classes)


def test_the_digests_are_those_of_the_official_lists():
    members = {name: _FACTS[name]["members"] for name in ("shrec10", "shrec11")}
    # A class of each list, as the tracks gave them out.
    crabs = (49, 15, 154, 83, 144, 26, 181, 139, 56, 82, 161, 9, 3, 187, 166, 156, 68, 162, 128, 19)
    assert members["shrec10"][members_digest(crabs)] == "crabs"
    alien = (
        137,
        30,
        50,
        124,
        290,
        5,
        422,
        545,
        411,
        9,
        511,
        311,
        31,
        547,
        418,
        573,
        220,
        133,
        18,
        228,
    )
    assert members["shrec11"][members_digest(alien)] == "alien"
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


def test_canonical_poses_are_the_null_shapes(sets):
    for name, subject, identifier in (
        ("kids", "0002", "0002.null.0"),
        ("topkids", "kid", "kid00"),
        ("shrec14-real", "3", "30"),
    ):
        assert canonical_shapes(open_dataset(name, sets))[subject].identifier == identifier


def test_an_absent_set_says_where_it_is_wanted_and_where_it_comes_from(tmp_path):
    with pytest.raises(
        DatasetError, match="'faust' is not at .*/faust; put it there .* http://faust.is.tue.mpg.de"
    ):
        open_dataset("faust", tmp_path)


def test_the_extended_table_is_made_for_every_set_that_is_here(sets, tmp_path):
    assert set(EXTENDED) == set(SETS) - {"tosca"} - {
        "shrec14-synthetic",
        "shrec14-real",
        "topkids",
        "scape",
    }
    assert list(
        dict.fromkeys(gallery.name for gallery in galleries(["extended"], data_root=sets))
    ) == [*EXTENDED]
    make("kids", tmp_path)
    chosen = galleries(["extended"], data_root=tmp_path)
    assert {(gallery.dataset.name, len(gallery.entries)) for gallery in chosen} == {("kids", 32)}
    assert {gallery.name for gallery in galleries([], ["kids"], tmp_path)} == {"kids"}

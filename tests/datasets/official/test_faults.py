"""Official sets that are not as they were given out: what is wrong is named, and costs no more than
it must.
"""

import pytest

from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import DatasetError
from benchmark.protocols.galleries import galleries
from tests.datasets.official.layouts import cla, class_of, write_tetrahedron
from tests.verbs import call


def relist(folder, change, name="test.cla"):
    text = (folder / "test.cla").read_text()
    (folder / "test.cla").unlink()
    (folder / name).write_text(change(text))


def moved(text, source, target):
    """Move the first model of one class to the end of another."""
    words = [block.split() for block in text.split("\n\n")]
    classes = {block[0]: [int(word) for word in block[3:]] for block in words[1:]}
    classes[target].append(classes[source].pop(0))
    return cla(classes)


FAULTS = {
    "a missing file": (
        "shrec07",
        lambda f: (f / "7.off").unlink(),
        "holds 399 shapes, not the official 400: shape '7' is missing",
    ),
    "a file too many": (
        "shrec07",
        lambda f: write_tetrahedron(f / "401.off", 9),
        "holds 401 shapes, not the official 400: 401.off is one too many; "
        "unpack the official archive",
    ),
    "zeros": (
        "shrec14-synthetic",
        lambda f: (f / "007.obj").touch(),
        "holds one shape as (7|007).obj and (7|007).obj",
    ),
    "a missing model": (
        "shrec11",
        lambda f: (f / "T137.off").unlink(),
        "test.cla lists 600 models for 599 meshes: there is no T137; unpack",
    ),
    "no list": (
        "shrec11",
        lambda f: (f / "test.cla").unlink(),
        "holds no list of classes; put the official .cla file",
    ),
    "two lists": (
        "shrec10",
        lambda f: relist(f, str, "sub.cla") or (f / "test.cla").touch(),
        "holds sub.cla and test.cla",
    ),
    "a label moved": (
        "shrec15",
        lambda f: relist(f, lambda text: moved(text, "class4", "class5")),
        "class '(class4' of .* has 23|class5' of .* has 25) models, not the official 24; "
        "fetch the official list",
    ),
    "two labels exchanged": (
        "shrec11",
        lambda f: relist(
            f, lambda text: moved(moved(text, "class4", "class5"), "class5", "class4")
        ),
        "classes 'class4', 'class5' of .*test.cla do not hold their official models; fetch",
    ),
    "a class of the cuts": (
        "shrec16-cuts",
        lambda f: [p.unlink() for p in f.glob("*wolf*")],
        "holds no shape of class 'wolf', cuts_wolf_shape_1",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_set_that_is_not_as_it_was_given_out_is_named(damaged, tmp_path, fault):
    name, damage, message = FAULTS[fault]
    folder = damaged(name)
    damage(folder)
    with pytest.raises(DatasetError, match=message):
        open_dataset(name, tmp_path)


def test_the_list_may_be_called_categories(sets, damaged, tmp_path):
    relist(damaged("shrec11"), str, "categories.txt")
    labels = [entry.subject for entry in open_dataset("shrec11", tmp_path).shapes]
    assert labels == [entry.subject for entry in open_dataset("shrec11", sets).shapes]


def test_folders_of_classes_take_the_place_of_the_list(sets, damaged, tmp_path):
    folder = damaged("shrec11")
    (folder / "test.cla").unlink()
    for number in range(600):
        place = (
            folder
            / "shrec_16"
            / f"beast{class_of(number, 30)}"
            / ("test" if number % 5 == 0 else "train")
        )
        place.mkdir(parents=True, exist_ok=True)
        (folder / f"T{number}.off").rename(place / f"T{number}.off")
    dataset, listed = open_dataset("shrec11", tmp_path), open_dataset("shrec11", sets)
    assert [(e.identifier, e.subject) for e in dataset.shapes] == [
        (e.identifier, e.subject) for e in listed.shapes
    ]
    # 31 and 1 are of one class; 32 is not.
    path = dataset.shapes[32].path
    path.rename(dataset.shapes[1].path.with_name("T32.off"))
    with pytest.raises(
        DatasetError,
        match="class 'beast[0-9]+' of .*shrec11 has (19|21) models, not the official 20",
    ):
        open_dataset("shrec11", tmp_path)


def test_a_set_of_one_subject_says_what_it_is_for(sets):
    said = call("data", "check", "scape", "--data-root", sets)
    assert (
        "data set 'scape' shows one subject, so nothing can be retrieved; use it with canonicalise"
        in said
    )
    with pytest.raises(
        DatasetError, match="'topkids' shows one subject, so nothing can be retrieved; use it with"
    ):
        galleries([], ["topkids"], sets)

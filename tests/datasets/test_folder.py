import pytest

from benchmark.datasets.base import check_retrievable, natural_key
from benchmark.datasets.folder import folder_dataset, read_cla
from benchmark.errors import DatasetError
from tests.toy import rod, write_off, write_rods

CLA = "PSB 1\n2 4\n\nman 0 2\n0\n1\n\nwoman 0 2\n2\n3\n"


def numbered(folder, count=4):
    for number in range(count):
        write_off(folder / f"{number}.off", rod(0.1, number))
    return folder


def test_classes_come_from_the_file_names(tmp_path):
    dataset = folder_dataset(write_rods(tmp_path / "rods"))
    assert [(e.identifier, e.subject, e.pose) for e in dataset.entries[:2]] == [
        ("thick0", "thick", "0"),
        ("thick1", "thick", "1"),
    ]
    assert dataset.name == "rods"
    assert dataset.load(dataset.entries[0]).n_faces == rod(0.1, 0).n_faces


def test_classes_come_from_sub_folders(tmp_path):
    for subject in ("cat", "dog"):
        for number in (10, 9):
            write_off(tmp_path / subject / f"{number}.off", rod(0.1, number))
    dataset = folder_dataset(tmp_path)
    assert [(e.identifier, e.subject) for e in dataset.entries] == [
        ("cat/9", "cat"),
        ("cat/10", "cat"),
        ("dog/9", "dog"),
        ("dog/10", "dog"),
    ]


def test_classes_come_from_a_cla_file(tmp_path):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text(CLA)
    assert [(e.identifier, e.subject) for e in folder_dataset(tmp_path).entries] == [
        ("0", "man"),
        ("1", "man"),
        ("2", "woman"),
        ("3", "woman"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PSB 2\n2 4\n", "does not start with 'PSB 1'"),
        (CLA.replace("2 4", "3 4"), "announces 3 classes and 4 models but lists 2 and 4"),
        (CLA.replace("woman 0 2", "woman 0 3"), "announces 3 models but lists 2"),
        (CLA.replace("3\n", "1\n"), "model 1 stands in two classes"),
        (CLA.replace("man 0 2", "man 0 two", 1), "expected '<name> <parent> <count>'"),
        (CLA.replace("\n3\n", "\n7\n"), "lists model 7, but .* has no mesh with that number"),
    ],
)
def test_a_wrong_cla_file_is_named(tmp_path, text, message):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text(text)
    with pytest.raises(DatasetError, match=message):
        folder_dataset(tmp_path)


def test_two_cla_files_are_one_too_many(tmp_path):
    numbered(tmp_path)
    for name in ("a.cla", "b.cla"):
        (tmp_path / name).write_text(CLA)
    with pytest.raises(DatasetError, match="holds 2 .cla files; keep the one"):
        folder_dataset(tmp_path)


def test_cla_round_trip(tmp_path):
    (tmp_path / "x.cla").write_text(CLA)
    assert read_cla(tmp_path / "x.cla") == {0: "man", 1: "man", 2: "woman", 3: "woman"}


def test_a_folder_without_meshes_is_named(tmp_path):
    with pytest.raises(DatasetError, match="no meshes in .*; expected files ending in"):
        folder_dataset(tmp_path)


def test_one_class_or_classes_of_one_shape_cannot_be_ranked(tmp_path):
    for number in range(3):
        write_off(tmp_path / "one" / f"cat{number}.off", rod(0.1, number))
    with pytest.raises(DatasetError, match="has one class \\('cat'\\).*sub-folder per class"):
        check_retrievable(folder_dataset(tmp_path / "one"))
    for name in ("cat", "dog"):
        write_off(tmp_path / "single" / f"{name}.off", rod(0.1, 1))
    with pytest.raises(DatasetError, match="each class of data set 'single' has one shape"):
        check_retrievable(folder_dataset(tmp_path / "single"))


def test_one_shape_in_several_formats_counts_once(tmp_path):
    numbered(tmp_path, 2)
    (tmp_path / "0.obj").write_text("v 0 0 0\n")
    assert [e.path.name for e in folder_dataset(tmp_path).entries] == ["0.off", "1.off"]


def test_natural_order():
    assert sorted(["cat10", "cat2", "cat1", "2", "10"], key=natural_key) == ["2", "10", "cat1", "cat2", "cat10"]


def test_the_recipe_follows_the_bytes_not_the_place(tmp_path):
    for name in ("a", "b"):
        write_rods(tmp_path / name)
    first, second = (folder_dataset(tmp_path / name) for name in ("a", "b"))
    assert [first.recipe(e) for e in first.entries] == [second.recipe(e) for e in second.entries]
    write_off(tmp_path / "b" / "thin0.off", rod(0.07, 0))
    changed = folder_dataset(tmp_path / "b")
    assert sum(first.recipe(a) != changed.recipe(b) for a, b in zip(first.entries, changed.entries, strict=True)) == 1

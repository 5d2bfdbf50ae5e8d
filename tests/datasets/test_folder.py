import os
import re
import sys
import unicodedata
from pathlib import Path

import pytest

from benchmark.datasets.base import canonical_shapes, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.folder import folder_set
from benchmark.datasets.official import SETS
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, SIDE, Camera
from tests.toy import rod, write_off, write_rods

#: Python reads some of these as numbers.
NO_NUMBERS = ("two", "1_0", "-1", "\u0663", "9" * 5000, "0x1")
WRONG_SETTINGS = Path(__file__).with_name("wrong-settings.txt").read_text()
CLA = "PSB 1\n2 4\n\nman 0 2\n0\n1\n\nwoman 0 2\n2\n3\n"


@pytest.fixture
def rods(tmp_path):
    return write_rods(tmp_path / "rods")


def numbered(folder):
    for number in range(4):
        write_off(folder / f"{number}.off", rod(0.1, number))
    return folder


@pytest.mark.parametrize(("order", "men"), [("0123", "01"), ("3021", "03")])
def test_classes_come_from_a_cla_file_in_the_order_of_the_numbers(tmp_path, order, men):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text(
        "PSB 1\n2 4\n\nman 0 2\n{}\n{}\n\nwoman 0 2\n{}\n{}\n".format(*order)
    )
    labels = {entry.identifier: entry.subject for entry in folder_set(tmp_path).shapes}
    assert list(labels.items()) == [
        (number, "man" if number in men else "woman") for number in "0123"
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("PSB 2\n2 4\n", "does not start with 'PSB 1'"),
        (CLA.replace("2 4", "3 4"), "announces 3 classes and 4 models but lists 2 and 4"),
        (CLA.replace("woman 0 2", "woman 0 3"), "announces 3 models but lists 2"),
        (CLA.replace("3\n", "1\n"), "model 1 stands in two classes"),
        (CLA.replace("woman", "man"), "class 'man' stands there twice"),
        (CLA.replace("\n3\n", "\n7\n"), "lists model 7, but .* has no mesh with that number"),
        (
            CLA.replace("\n0\n", "\n4\n"),
            "lists model 4, .*counts from 1, the meshes from 0: subtract 1",
        ),
        *(
            (CLA.replace("0 2", f"0 {word}"), "is not a whole number; expected '<name>")
            for word in NO_NUMBERS
        ),
    ],
)
def test_a_wrong_cla_file_is_named(tmp_path, text, message):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text(text)
    with pytest.raises(DatasetError, match=message):
        folder_set(tmp_path)


def test_classes_of_one_shape_cannot_be_ranked(tmp_path):
    for name in ("cat", "dog"):
        write_off(tmp_path / "single" / f"{name}.off", rod(0.1, 1))
    with pytest.raises(
        DatasetError, match="each class of data set 'single' has one shape"
    ) as error:
        check_retrievable(folder_set(tmp_path / "single"))
    assert "list them in labels.txt" in error.value.hint


def test_the_recipe_follows_the_bytes_not_the_place(tmp_path):
    for name in ("a", "b"):
        write_rods(tmp_path / name)
    first, second = (folder_set(tmp_path / name) for name in ("a", "b"))
    assert [first.key(e) for e in first.shapes] == [second.key(e) for e in second.shapes]
    write_off(tmp_path / "b" / "thin0.off", rod(0.07, 0))
    changed = folder_set(tmp_path / "b")
    assert (
        sum(
            first.key(a) != changed.key(b)
            for a, b in zip(first.shapes, changed.shapes, strict=True)
        )
        == 1
    )
    before, path = [first.key(entry) for entry in first.shapes], first.shapes[3].path
    path.write_text(path.read_text().replace("0.1", "0.2"))  # of the same size
    os.utime(path, ns=(0, 0))
    assert [first.key(entry) != key for entry, key in zip(first.shapes, before, strict=True)] == [
        k == 3 for k in range(6)
    ]


def test_a_number_that_two_files_bear_is_named(tmp_path):
    numbered(tmp_path)
    write_off(tmp_path / "03.off", rod(0.1, 1.0))
    (tmp_path / "test.cla").write_text(CLA)
    with pytest.raises(
        DatasetError, match="lists model 3, which may be 3.off or 03.off|03.off or 3.off"
    ):
        folder_set(tmp_path)


def test_a_cla_file_cannot_lead_out_of_its_folder(tmp_path):
    numbered(tmp_path / "set")
    (tmp_path / "set" / "test.cla").write_text(CLA)
    (tmp_path / "set" / "1.off").rename(tmp_path / "secret.off")
    (tmp_path / "set" / "1.off").symlink_to(tmp_path / "secret.off")
    with pytest.raises(
        DatasetError, match="names '1.off', which lies outside its folder; copy the mesh"
    ):
        folder_set(tmp_path / "set")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
def test_names_that_cannot_be_printed_are_written_so_that_they_can(rods):
    raw = os.fsencode(rods)
    (rods / "thin0.off").rename(rods / "thin\n0.off")
    (rods / "thin1.off").rename(rods / "thin\x1b[31m1.off")
    os.rename(raw + b"/thin2.off", raw + b"/thin\xff2.off")  # noqa: PTH104
    entries = {entry.identifier: entry for entry in folder_set(rods).shapes}
    assert {r"thin\n0", r"thin\x1b[31m1", r"thin\udcff2"} <= entries.keys()
    assert entries[r"thin\n0"].subject == r"thin\n"
    for number in range(2):
        write_off(rods / f"fat\xa0{number}.off", rod(0.2, number))
        write_off(rods / f"thin{number}\n.off", rod(0.2, number))
    classes = [entry.subject for entry in folder_set(rods).shapes]
    assert (classes.count("fat"), classes.count(r"thin0\n")) == (2, 1)
    for entry in entries.values():
        for text in (entry.identifier, entry.subject, entry.pose):
            assert text.isprintable()
            text.encode("utf-8")
        assert folder_set(rods).load(entry).n_vertices == 290
    (rods / r"thin\n0.off").write_bytes((rods / "thin\n0.off").read_bytes())
    assert r"thin\\n0" in {entry.identifier for entry in folder_set(rods).shapes}


@pytest.mark.parametrize("name", ["caf\u00e9", "\u00c5se", "\ud55c", "\u1ec7"])
def test_names_are_the_same_in_both_forms_of_unicode_wherever_they_stand(tmp_path, name):
    for number, form in enumerate(("NFC", "NFD", "NFC")):
        write_off(tmp_path / f"{unicodedata.normalize(form, name)}{number}.off", rod(0.1, number))
    (tmp_path / "dataset.toml").write_text(
        f'[canonical_pose]\n{unicodedata.normalize("NFD", name)!r} = "1"\n'
    )
    dataset = folder_set(tmp_path)
    assert {entry.subject for entry in dataset.shapes} == {name}
    assert canonical_shapes(dataset)[name].identifier == f"{name}1"
    labels = "".join(
        f"{unicodedata.normalize('NFD', name)}{number} {name}\n" for number in range(3)
    )
    (tmp_path / "labels.txt").write_text(labels)
    (tmp_path / "dataset.toml").unlink()
    assert {entry.subject for entry in folder_set(tmp_path).shapes} == {name}
    write_off(tmp_path / f"{unicodedata.normalize('NFD', name)}0.off", rod(0.1, 0))
    with pytest.raises(DatasetError, match="two shapes that are both written"):
        folder_set(tmp_path)


def test_names_that_differ_in_what_cannot_be_printed_are_two_classes(tmp_path):
    for name in ("a", "a\n", "a ", r"a\n"):
        write_off(tmp_path / name / "0.off", rod(0.1, 1))
    assert {entry.subject for entry in folder_set(tmp_path).shapes} == {"a", r"a\n", "a ", r"a\\n"}


def test_what_systems_write_beside_shapes_is_no_shape(rods):
    for name in (
        "._thin0.off",
        ".hidden.obj",
        "._labels.txt",
        "._x.cla",
        "__MACOSX/a.off",
        ".DS_Store",
        "Thumbs.db",
    ):
        (rods / name).parent.mkdir(exist_ok=True)
        (rods / name).write_text("")
    assert len(folder_set(rods).shapes) == 6
    os.mkfifo(rods / "thin7.off")
    with pytest.raises(UnreadableMesh, match=r"thin7\.off: it is a pipe or a device"):
        folder_set(rods).load(folder_set(rods).shapes[-1])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("labels.json", b'{"thin0": "odd"}'),
        ("labels.yaml", b"thin0: odd\n"),
        ("labels.YML", b"thin0: odd\n"),
        ("labels.xml", b"<labels/>"),
        ("labels.xlsx", b"PK\x03\x04"),
        ("labels.npy", b"\x93NUMPY"),
        ("labels.npz", b"PK\x03\x04"),
        ("labels.mat", b"MATLAB 5.0 MAT-file\0"),
        ("labels.pkl", b"\x80\x04"),
    ],
)
def test_labels_that_cannot_be_read_are_refused_and_no_names_taken_instead(rods, name, content):
    (rods / name).write_bytes(content)
    with pytest.raises(BenchmarkError, match=name):
        folder_set(rods)


@pytest.mark.parametrize(
    ("name", "mark"), [("labels.txt", " "), ("labels.csv", ","), ("Labels.TSV", "\t")]
)
def test_a_list_of_labels_is_the_first_rule(rods, name, mark):
    rows = [
        f"{build}{number}{mark}{'odd' if number % 2 else 'even'}"
        for build in ("thin", "thick")
        for number in range(3)
    ]
    (rods / name).write_bytes(b"\xef\xbb\xbf" + "\r\n".join(rows).encode())
    assert {entry.identifier: entry.subject for entry in folder_set(rods).shapes}["thick1"] == "odd"
    (rods / name).write_text("\n".join([*rows[1:], f"fat0{mark}even"]))
    with pytest.raises(
        DatasetError,
        match=f"{name} and the shapes beside it differ in thin0, fat0; name each shape once",
    ):
        folder_set(rods)
    (rods / name).write_text("\n".join([f"Name{mark}Label", *rows]))
    assert {entry.identifier: entry.subject for entry in folder_set(rods).shapes}["thick1"] == "odd"
    (rods / name).write_text("\n".join(["labels", *rows]))
    with pytest.raises(
        BenchmarkError, match=f"{name}: its first line, 'labels', may name the columns; delete it"
    ):
        folder_set(rods)
    (rods / name).write_text("even\n" * 6)
    with pytest.raises(DatasetError, match=f"{name} does not name the shapes"):
        folder_set(rods)
    (rods / "x.CLA").write_text(CLA)
    with pytest.raises(DatasetError, match=f"holds {name} and x.CLA; keep the list"):
        folder_set(rods)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["README"], "no meshes in {folder}; expected files ending in .off"),
        (["README", "a.docx", "b.exr"], "no meshes in {folder} that can be read: .docx, .exr cann"),
        (["._cat0.off", "a.docx"], "no meshes in {folder} but hidden ones, ._cat0.off; expected"),
    ],
)
def test_a_folder_without_shapes_says_what_it_holds_instead(tmp_path, files, said):
    for name in files:
        (tmp_path / name).write_text("")
    with pytest.raises(DatasetError, match=re.escape(said.format(folder=tmp_path))):
        folder_set(tmp_path)


# Settings


def settled(folder, text):
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder_set(folder)


def cameras(dataset):
    return {e.subject: dataset.camera(e) for e in dataset.shapes}


@pytest.mark.parametrize(
    ("text", "canonical", "of_classes"),
    [
        ('canonical_pose = 1\ncamera = "back"\n', ["thick1", "thin1"], [Camera((0, -1, 0))] * 2),
        (
            '[canonical_pose]\nthin = "2"\n[camera]\nthin = { direction = [-2, 0, 0] }\n',
            *(["thick0", "thin2"], [FRONT, Camera((-1, 0, 0))]),
        ),
    ],
    ids=["whole set", "class"],
)
def test_settings_of_a_set_or_of_a_class(rods, text, canonical, of_classes):
    dataset = settled(rods, 'half_width = 2\nstand_in_for = "tosca"\n' + text)
    assert [
        canonical_shapes(dataset)[subject].identifier for subject in ("thick", "thin")
    ] == canonical
    assert list(cameras(dataset).values()) == of_classes
    assert (dataset.half_width, dataset.stand_in_for) == (2.0, "tosca")


@pytest.mark.parametrize("changes", ["", "[noise=2]"])
def test_a_folder_stands_in_for_an_official_set_alone(rods, changes):
    settled(rods, 'stand_in_for = "tosca"\n')
    assert open_dataset(f"{rods}{changes}").stand_in_for == "tosca"
    for name, hint in (("tosac", "did you mean tosca"), ("animals", "choose one of")):
        settled(rods, f'stand_in_for = "{name}"\n')
        with pytest.raises(ConfigurationError, match=f"under stand_in_for of .*'{name}'; {hint}"):
            open_dataset(f"{rods}{changes}")


@pytest.mark.parametrize("name", [name for name, known in CATALOGUE.items() if not known.folder])
def test_a_generated_set_stands_in_for_an_official_set_or_for_none(name):
    assert open_dataset(name).stand_in_for in ("", *SETS)


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        ('camera = "side"', SIDE),
        ("camera = { direction = [0, 0, -3], up = [0, 2, 0.5] }", Camera((0, 0, -1), (0, 1, 0))),
        ('up = "y"', Camera((0, 0, -1), (0, 1, 0))),
        ('up = "y"\ncamera = "back"', Camera((0, 0, 1), (0, 1, 0))),
        ('up = "y"\ncamera = { direction = [1, 0, 0] }', Camera((1, 0, 0), (0, 1, 0))),
    ],
)
def test_cameras(rods, text, camera):
    assert cameras(settled(rods, text)) == {"thick": camera, "thin": camera}


def test_the_up_axis_is_that_of_shapes_for_which_no_camera_is_named_too(rods):
    sides = cameras(settled(rods, 'up = "y"\n[camera]\nthin = "side"\n'))
    front = Camera((0, 0, -1), (0, 1, 0))
    assert sides == {"thick": front, "thin": Camera((1, 0, 0), (0, 1, 0))}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *(line.replace("\\n", "\n").split(" | ") for line in WRONG_SETTINGS.splitlines()),
        ("half_width = 1" + "0" * 400, "half_width is 10"),
        ("half_width = " + "9" * 5000, "not a readable settings file"),
        ("half_width = " + "[" * 5000, "nested too deeply"),
        ("a" + ".a" * 50_000 + " = 1", "a key has too many dots"),
        ("camera = { direction = [1" + "0" * 400 + ", 0, 0] }", "write the name of a view"),
    ],
)
def test_wrong_settings_are_named(rods, text, message):
    with pytest.raises(BenchmarkError, match=message) as caught:
        settled(rods, text)
    assert re.search(r"dataset\.toml", str(caught.value))

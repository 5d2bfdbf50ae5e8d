import os
import re

import pytest

from benchmark.datasets.base import canonical_shapes, check_retrievable
from benchmark.datasets.folder import folder_set
from benchmark.errors import BenchmarkError, DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from tests.toy import rod, write_off, write_rods

CLA = "PSB 1\n2 4\n\nman 0 2\n0\n1\n\nwoman 0 2\n2\n3\n"


def numbered(folder, count=4):
    for number in range(count):
        write_off(folder / f"{number}.off", rod(0.1, number))
    return folder


def listed(folder):
    return [(entry.identifier, entry.subject) for entry in folder_set(folder).shapes]


def test_classes_come_from_the_file_names(tmp_path):
    dataset = folder_set(write_rods(tmp_path / "rods"))
    assert [(e.identifier, e.subject, e.pose) for e in dataset.shapes[1:4:2]] == [
        *(("thick1", "thick", "1"), ("thin0", "thin", "0"))
    ]
    assert dataset.name == "rods"
    assert dataset.load(dataset.shapes[0]).n_faces == rod(0.1, 0).n_faces


@pytest.mark.parametrize(("order", "men"), [("0123", "01"), ("3021", "03")])
def test_classes_come_from_a_cla_file_in_the_order_of_the_numbers(tmp_path, order, men):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text("PSB 1\n2 4\n\nman 0 2\n{}\n{}\n\nwoman 0 2\n{}\n{}\n".format(*order))
    assert listed(tmp_path) == [(number, "man" if number in men else "woman") for number in "0123"]


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
        folder_set(tmp_path)


def test_one_class_or_classes_of_one_shape_cannot_be_ranked(tmp_path):
    for number in range(3):
        write_off(tmp_path / "one" / f"cat{number}.off", rod(0.1, number))
    with pytest.raises(DatasetError, match="has one class \\('cat'\\).*sub-folder per class"):
        check_retrievable(folder_set(tmp_path / "one"))
    for name in ("cat", "dog"):
        write_off(tmp_path / "single" / f"{name}.off", rod(0.1, 1))
    with pytest.raises(DatasetError, match="each class of data set 'single' has one shape"):
        check_retrievable(folder_set(tmp_path / "single"))


def test_the_recipe_follows_the_bytes_not_the_place(tmp_path):
    for name in ("a", "b"):
        write_rods(tmp_path / name)
    first, second = (folder_set(tmp_path / name) for name in ("a", "b"))
    assert [first.key(e) for e in first.shapes] == [second.key(e) for e in second.shapes]
    write_off(tmp_path / "b" / "thin0.off", rod(0.07, 0))
    changed = folder_set(tmp_path / "b")
    assert sum(first.key(a) != changed.key(b) for a, b in zip(first.shapes, changed.shapes, strict=True)) == 1
    before, path = [first.key(entry) for entry in first.shapes], first.shapes[3].path
    path.write_text(path.read_text().replace("0.1", "0.2"))  # of the same size
    os.utime(path, ns=(0, 0))
    assert [first.key(entry) != key for entry, key in zip(first.shapes, before, strict=True)] == [
        k == 3 for k in range(6)
    ]


def test_a_cla_file_that_counts_from_1_is_told_so(tmp_path):
    numbered(tmp_path)
    (tmp_path / "test.cla").write_text("PSB 1\n2 4\n\nman 0 2\n1\n2\n\nwoman 0 2\n3\n4\n")
    with pytest.raises(DatasetError, match="lists model 4, .*counts from 1, the meshes from 0: subtract 1"):
        folder_set(tmp_path)


def test_a_number_that_two_files_bear_is_named(tmp_path):
    numbered(tmp_path)
    write_off(tmp_path / "03.off", rod(0.1, 1.0))
    (tmp_path / "test.cla").write_text(CLA)
    with pytest.raises(DatasetError, match="lists model 3, which may be 3.off or 03.off|03.off or 3.off"):
        folder_set(tmp_path)


def test_a_cla_file_cannot_lead_out_of_its_folder(tmp_path):
    numbered(tmp_path / "set")
    (tmp_path / "set" / "test.cla").write_text(CLA)
    (tmp_path / "set" / "1.off").rename(tmp_path / "secret.off")
    (tmp_path / "set" / "1.off").symlink_to(tmp_path / "secret.off")
    with pytest.raises(DatasetError, match="names '1.off', which lies outside its folder; copy the mesh"):
        folder_set(tmp_path / "set")


# Settings


def settled(tmp_path, text):
    write_rods(tmp_path / "rods")
    (tmp_path / "rods" / "dataset.toml").write_text(text, encoding="utf-8")
    return folder_set(tmp_path / "rods")


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
def test_settings_of_a_set_or_of_a_class(tmp_path, text, canonical, of_classes):
    dataset = settled(tmp_path, 'half_width = 2\nstand_in_for = "tosca"\n' + text)
    assert [canonical_shapes(dataset)[subject].identifier for subject in ("thick", "thin")] == canonical
    assert list(cameras(dataset).values()) == of_classes
    assert (dataset.half_width, dataset.stand_in_for) == (2.0, "tosca")


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        ('camera = "side"', SIDE),
        ("camera = { direction = [0, 0, -3], up = [0, 1, 0.5] }", Camera((0, 0, -1), (0, 1, 0))),
        ('up = "y"', Camera((0, 0, -1), (0, 1, 0))),
        ('up = "y"\ncamera = "back"', Camera((0, 0, 1), (0, 1, 0))),
        ('up = "y"\ncamera = { direction = [1, 0, 0] }', Camera((1, 0, 0), (0, 1, 0))),
    ],
)
def test_cameras(tmp_path, text, camera):
    assert cameras(settled(tmp_path, text)) == {"thick": camera, "thin": camera}


def test_y_up_shows_what_z_up_shows_of_the_turned_shape(tmp_path):
    from benchmark.geometry.depth import camera_coordinates

    mesh = rod(0.1, 1.0)
    x, y, z = mesh.vertices.T
    turned = mesh.with_vertices(list(zip(x, z, -y, strict=True)))
    for view in ("front", "side", "back", "other-side"):
        upright = cameras(settled(tmp_path, f'camera = "{view}"'))["thin"]
        lying = cameras(settled(tmp_path, f'camera = "{view}"\nup = "y"'))["thin"]
        assert camera_coordinates(turned, lying) == pytest.approx(camera_coordinates(mesh, upright), abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('camra = "front"', "unknown key of .*dataset.toml 'camra'; did you mean camera"),
        ('[camera]\nthik = "front"', "unknown class under camera in .*toml 'thik'; did you mean thick"),
        ("camera = 3", "3 is no camera; write the name of a view, or { direction"),
        ("camera = { direction = [0, 1, 0], upp = [0, 0, 1] }", "unknown key of a camera in .* 'upp'; did you mean up"),
        ("camera = { direction = [0, 1] }", "dataset.toml: .*write the name of a view"),
        ('canonical_pose = "7"', "unknown pose of class 'thick' in .*toml '7'; choose one of 0, 1, 2"),
        ("canonical_pose = 1.5", "the canonical pose of 'thick' is 1.5; write a pose in quotes"),
        ("half_width = 0", "half_width is 0; write a positive number"),
        ("half_width = inf", "half_width is inf; write a positive number"),
        ("camera = ", "cannot read .*dataset.toml: .*correct the file or remove it"),
    ],
)
def test_wrong_settings_are_named(tmp_path, text, message):
    with pytest.raises(BenchmarkError, match=message) as caught:
        settled(tmp_path, text)
    assert re.search(r"dataset\.toml", str(caught.value))

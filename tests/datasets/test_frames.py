"""Folders of depth images as data sets."""

import re

import numpy as np
import pytest
from PIL import Image

from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.checking import check_dataset, unread_files
from benchmark.errors import ConfigurationError, DatasetError, DepthError, UnsupportedShape
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.prepared import PreparedShapes
from benchmark.pipeline.stages import require_result
from tests.depth.scenes import SMALL_CAMERA, in_millimetres, small_frame
from tests.toy import rod, write_off


def write_frames(folder, classes=("one", "two"), count=2):
    for number, subject in enumerate(classes):
        (folder / subject).mkdir(parents=True)
        for pose in range(count):
            depths, mask = small_frame(seed=10 * number + pose)
            colour = Image.new("RGB", SMALL_CAMERA.size)
            images = (
                (Image.fromarray(in_millimetres(depths)), ""),
                (Image.fromarray(mask), "_mask"),
                (colour, "-colour"),
            )
            for image, ending in images:
                image.save(folder / subject / f"{pose}{ending}.png", compress_level=1)
    (folder / "intrinsics.txt").write_text("262.5 0 159.75\n0 262.5 119.75\n0 0 1\n")
    return folder


def test_a_shape_is_read_from_its_image_its_mask_and_its_intrinsics(frames):
    dataset = open_dataset(str(frames), None)
    files = [path.resolve() for path in dataset.files(dataset.shapes[0])]
    names = [path.relative_to(frames.resolve()).as_posix() for path in files]
    assert names == ["one/0.png", "one/0_mask.png", "intrinsics.txt"]


def test_depth_images_are_shapes_and_masks_and_colours_are_none(frames):
    dataset = open_dataset(str(frames), None)
    assert dataset.observe is not None and dataset.inputs == ("view",)
    assert [(entry.identifier, entry.subject) for entry in dataset.shapes] == [
        ("one/0", "one"),
        ("one/1", "one"),
        ("two/0", "two"),
        ("two/1", "two"),
    ]
    report = check_dataset(dataset)
    assert report.usable
    assert not report.anomalies
    taken = [
        line
        for line in report.lines()
        if line.startswith(("unit", "camera", "mask", "depths", "distance", "size"))
    ]
    assert taken[:3] == [
        "unit        assumed 1 / 1000 m (4)",
        "camera      ../intrinsics.txt (4)",
        "mask        NAME_mask.png (4)",
    ]
    assert all(re.search(r"[1-4]\.\d+ to [1-4]\.\d+ m$", line) for line in taken[3:])


def test_a_mask_that_images_of_two_classes_would_share_is_refused(tmp_path):
    frames = write_frames(tmp_path / "frames", count=2)
    for mask in sorted(frames.glob("*/*_mask.png")):
        place = frames / "masks" / mask.parent.name
        place.mkdir(parents=True, exist_ok=True)
        mask.rename(place / mask.name)
    dataset = open_dataset(str(frames), None)
    masks = [dataset.files(entry)[1].relative_to(frames.resolve()) for entry in dataset.shapes]
    assert [mask.as_posix() for mask in masks] == [
        "masks/one/0_mask.png",
        "masks/one/1_mask.png",
        "masks/two/0_mask.png",
        "masks/two/1_mask.png",
    ]
    for mask in sorted(frames.glob("masks/one/*")):
        mask.rename(frames / "masks" / mask.name)
    for mask in sorted(frames.glob("masks/two/*")):
        mask.unlink()
    said = "'one/0' and 'two/0' have one mask, 0_mask.png; put the mask of each "
    with pytest.raises(DatasetError, match=said):
        open_dataset(str(frames), None)


def test_images_that_are_passed_over_are_named(tmp_path):
    frames = write_frames(tmp_path / "frames", count=2)
    depths, mask = small_frame(seed=7)
    (frames / "three" / "day").mkdir(parents=True)
    (frames / "masks").mkdir()
    Image.fromarray(in_millimetres(depths)).save(frames / "three" / "day" / "0.png")
    Image.fromarray((in_millimetres(depths) // 16).astype(np.uint8)).save(frames / "one" / "2.png")
    Image.fromarray(mask).save(frames / "one" / "2_mask.png")
    Image.fromarray(mask.astype(np.uint8)).save(frames / "masks" / "9.png")
    said = [str(anomaly) for anomaly in unread_files(open_dataset(str(frames), None))]
    assert [line.partition(";")[0] for line in said] == [
        "warning  one/2.png  skipped: grey of 8 bits, no depth",
        "warning  three/day/0.png  none of the shapes of this data set",
    ]


def test_data_check_says_how_many_pieces_a_run_joins_and_why_forms_may_be_wrong(tmp_path):
    folder = write_frames(tmp_path / "frames", count=1)
    mask = np.array(Image.open(folder / "one" / "0_mask.png"))
    middle = int(np.median(np.nonzero(mask)[0]))
    mask[middle - 5 : middle + 5] = 0
    Image.fromarray(mask).save(folder / "one" / "0_mask.png")
    depths = np.array(Image.open(folder / "two" / "0.png"))
    sparse = np.zeros_like(depths)
    sparse[::3, ::3] = depths[::3, ::3]
    Image.fromarray(sparse).save(folder / "two" / "0.png")
    said = "\n".join(map(str, check_dataset(open_dataset(str(folder), None)).anomalies))
    assert re.search(r"one/0.png.*  joined_pieces [2-9].*: .*; a run bridges them", said)
    assert re.search(r"warning  two/0.png  the object shows \d+ pixels, so its form depends", said)


def test_a_method_gets_a_depth_image_in_the_frame_of_the_humans_and_the_surface_behind_it(
    frames, tmp_path
):
    dataset = open_dataset(str(frames), None)
    assert dataset.half_width == 1.285
    shape = shape_of(PreparedShapes(dataset, "view").prepare(dataset.shapes[0], 1.285), "one/0")
    assert shape.depth.shape == (500, 500)
    rows = np.flatnonzero(shape.depth.any(axis=1))
    assert len(rows) * 2.57 / 500 == pytest.approx(1.65, abs=0.1)
    assert shape.mesh.area == pytest.approx(1)
    assert 0.5 < shape.source_area < 1.2  # square metres of the front of a body


def test_what_determines_a_shape_are_all_its_files_and_settings(tmp_path):
    dataset = open_dataset(str(write_frames(tmp_path / "frames", count=1)), None)
    entry, other = dataset.shapes
    before = dataset.key(entry)
    assert before != dataset.key(other)
    for file in ("one/0_mask.png", "intrinsics.txt"):
        path = tmp_path / "frames" / file
        old = path.read_bytes()
        path.write_bytes(old + b"\n")
        assert dataset.key(entry) != before, file
        path.write_bytes(old)
    (tmp_path / "frames" / "dataset.toml").write_text("depth_scale = 999")
    assert open_dataset(str(tmp_path / "frames"), None).key(entry) != before


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("disparity.png", "0.png"), ("0.npy", "0.png"), ("0_mask.npy", "0_mask.png")],
)
def test_a_shape_whose_file_is_renamed_is_another_as_a_refusal_is_kept(tmp_path, wrong, right):
    one = write_frames(tmp_path / "frames", classes=("one",), count=1) / "one"

    def key():
        (entry,) = open_dataset(str(one.parent), None).shapes
        return open_dataset(str(one.parent), None).key(entry).replace(entry.identifier, "")

    if "mask" not in wrong:
        (one / "0_mask.png").unlink()
    good = key()
    (one / right).rename(one / wrong)
    refused = open_dataset(str(one.parent), None)
    with pytest.raises(DepthError):
        refused.load(refused.shapes[0])
    assert key() != good


def test_images_beside_meshes_are_textures(frames, tmp_path):
    folder = tmp_path / "meshes"
    write_off(folder / "cat0.off", rod(0.1, 0.5))
    (folder / "cat0.png").write_bytes((frames / "one" / "0.png").read_bytes())
    assert [entry.identifier for entry in open_dataset(str(folder), None).shapes] == ["cat0"]


def test_settings_are_applied(tmp_path):
    folder = write_frames(tmp_path / "frames", count=1)
    (folder / "intrinsics.txt").unlink()
    toml = folder / "dataset.toml"
    toml.write_text(
        'intrinsics = "262.5,262.5,159.75,119.75"\ndepth_scale = 1000\n'
        "up = [0.1, -1, 0]\nhalf_width = 1.5\n"
        "[canonical_pose]\none = 0\n"
    )
    dataset = open_dataset(str(folder), None)
    assert dataset.half_width == 1.5
    assert "fx=262.5" in dataset.key(dataset.shapes[0]) and "1000.0" in dataset.key(
        dataset.shapes[0]
    )
    assert dataset.canonical_poses == {"one": "0"}
    assert dataset.load(dataset.shapes[0]).n_vertices > 1000
    for text, said in (
        (
            "scale = 5",
            "unknown key .*, in a folder of depth images 'scale'; did you mean depth_scale",
        ),
        ("up = [0, 0, 1]", "not a usable up direction"),
        ("up = ['0', '-1', 'y']", "write .right, down, forward."),
        ("depth_scale = -1", "depth_scale is -1; write a positive number"),
        ('intrinsics = "absent.json"', "No such file"),
        (
            "[canonical_pose]\nthree = 0",
            "unknown class under canonical_pose in .* 'three'; choose one of one, two",
        ),
    ):
        toml.write_text(text)
        with pytest.raises((DatasetError, ConfigurationError), match=said):
            open_dataset(str(folder), None)


def test_each_bad_image_costs_one_shape(tmp_path):
    folder = write_frames(tmp_path / "frames")
    (folder / "one" / "1.png").write_bytes((folder / "one" / "0.png").read_bytes()[:20000])
    (folder / "two" / "intrinsics.txt").write_text("0 0 0 0 0 0 0 0 1")
    prepared_shapes = PreparedShapes(open_dataset(str(folder), None), "view")
    good, cut, wrong, twin = prepared_shapes.shapes.shapes
    assert "vertices" in prepared_shapes.prepare(good, 1.285)
    camera = "invalid focal lengths 0, 0"
    for entry, message in (
        (cut, "not a readable png file"),
        (wrong, camera),
        (twin, camera),
    ):
        with pytest.raises(UnsupportedShape, match=message):
            require_result(prepared_shapes.prepare(entry, 1.285))

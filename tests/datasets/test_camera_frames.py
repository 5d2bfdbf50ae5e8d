"""The stand-in camera: scenes as they are promised, and files that read as the data set."""

import numpy as np
import pytest
from PIL import Image

from benchmark.datasets.camera_frames import DISTANCES, HEIGHTS, WALLS, CameraFrames
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.export import export_frames
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS
from benchmark.datasets.perturbations.overview import overview
from benchmark.depth.frame import observe
from benchmark.errors import ConfigurationError
from benchmark.protocols.galleries import galleries
from benchmark.protocols.tables import TABLES
from tests.depth.scenes import overlap


class Few(CameraFrames):
    """Four frames of two subjects."""

    @property
    def entries(self):
        return tuple(entry for entry in super().entries[::5] if entry.subject in ("man-1", "child-2"))[:8:2]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "frames"
    return folder, export_frames(Few(), folder)


def test_files_read_as_the_data_set(exported):
    folder, names = exported
    dataset, entries = open_dataset(str(folder), None), Few().entries
    assert len(names) == 2 * len(entries) + 1
    assert {(entry.subject, entry.pose) for entry in dataset.entries} == {(e.subject, e.pose) for e in entries}
    by_pose = {(entry.subject, entry.pose): entry for entry in dataset.entries}
    for entry in entries[:2]:
        read, made = dataset.load(by_pose[entry.subject, entry.pose]), Few().load(entry)
        np.testing.assert_array_equal(read.vertices, made.vertices)
        np.testing.assert_array_equal(read.faces, made.faces)
        assert dataset.half_width == Few.half_width
    with Image.open(folder / names[0]) as image:
        assert (image.size, image.mode) == ((640, 480), "I;16")


@pytest.mark.parametrize("poses", [1, 15, 30])
def test_a_set_has_as_many_poses_as_it_says(poses):
    dataset = CameraFrames(poses=poses)
    assert len(dataset.entries) == 15 * min(poses, 20)
    assert f"15 subjects x {min(poses, 20)} poses" in dataset.title


def test_scenes_are_as_promised_and_the_rule_finds_the_body():
    dataset = Few()
    for entry in dataset.entries[:3]:
        scene = dataset.scene(entry)
        assert DISTANCES[0] <= -scene.pose.position[1] <= DISTANCES[1]
        assert HEIGHTS[0] <= scene.pose.position[2] <= HEIGHTS[1]
        assert WALLS[0] <= scene.wall <= WALLS[1]
        depths, mask = dataset.frame(entry)
        assert overlap(observe(depths, dataset.intrinsics).mask, mask & (depths > 0)) > 0.9
        again, _ = dataset.frame(entry)
        np.testing.assert_array_equal(depths, again)
        np.testing.assert_array_equal(depths, np.round(depths, 3))


def test_its_table_has_the_folds_of_table_one_and_is_made_by_name_alone():
    chosen = galleries(["camera"])
    first = galleries(["I"])
    assert [[e.identifier for e in gallery.entries] for gallery in chosen] == [
        [e.identifier for e in gallery.entries] for gallery in first[:3]
    ]
    assert all(gallery.inputs == ("view",) for gallery in chosen)
    assert "camera" not in {gallery.table.identifier for gallery in galleries()}
    assert [gallery.table.identifier for gallery in galleries(dataset_names=["camera"])] == ["camera"] * 3
    assert "camera" in {table.identifier for table in TABLES}


def test_frames_have_perturbations_of_their_own():
    known = {name for name, each in PERTURBATIONS.items() if each.of_frames}
    made = {gallery.dataset.name for gallery in galleries(["robustness"], ["camera-few"])}
    assert made == {"camera-few", *(f"camera-few[{name}={k}]" for name in known for k in STRENGTHS)}
    clean = open_dataset("camera-few", None)
    entry = clean.entries[7]
    assert len(clean.entries) == 60
    recipes = {open_dataset(f"camera-few[{name}=2]", None).recipe(entry) for name in known}
    assert len(recipes) == len(known)
    seen = open_dataset("camera-few[occlusion=5]", None).load(entry)
    assert 0.3 < seen.area / clean.load(entry).area < 0.7
    shown = overview(clean, entry.identifier)
    assert {each.subject for each in shown.entries} == known
    (boxed,) = (each for each in shown.entries if each.identifier == "occlusion=5")
    np.testing.assert_array_equal(shown.load(boxed).vertices, seen.vertices)
    with pytest.raises(ConfigurationError, match="animals-few has no frames of a depth camera"):
        open_dataset("animals-few[occlusion=1]", None)


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_so_many_pixels_of_a_mask_are_wrong(share):
    entry = Few().entries[1]
    _, mask = CameraFrames().frame(entry)
    _, wrong = CameraFrames(wrong_mask=share).frame(entry)
    assert np.count_nonzero(wrong != mask) / mask.sum() == pytest.approx(share, abs=0.01)
    assert (wrong & ~mask).any() and (mask & ~wrong).any()


def test_a_box_hides_so_much_of_the_object_and_stands_before_it():
    for entry in Few().entries:
        depths, mask = CameraFrames().frame(entry)
        behind, seen = CameraFrames(hidden=0.3).frame(entry)
        assert np.count_nonzero(seen) / mask.sum() == pytest.approx(0.7, abs=0.03)
        assert not (seen & ~mask).any()
        hidden = mask & ~seen & (behind > 0) & (depths > 0)
        assert np.median(behind[hidden]) < depths[hidden].min() - 0.2  # some pixels at its edge fly

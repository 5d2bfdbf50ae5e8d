import struct

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.cli.main import data
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.folder import folder_set
from benchmark.errors import BenchmarkError, UnreadableMesh
from benchmark.report.pictures import sheets
from benchmark.report.pictures.painting import save_png
from benchmark.report.pictures.posing import select
from benchmark.report.pictures.sheets import WIDTH, contact_sheet
from tests.toy import rod, write_rods


def rods(n_subjects=2, n_poses=3, own_poses=False, broken="", half_width=1.0):
    """Bent rods of any number of builds and poses; every shape may be made another one or unreadable."""

    def load(entry):
        if entry.identifier == broken:
            raise UnreadableMesh("the file is cut off", "copy it again")
        subject, pose = map(int, entry.identifier.split("-"))
        return rod(0.05 + 0.02 * subject, 0.5 * pose)

    shapes = tuple(
        Entry(f"{s}-{p}", f"subject-{s}", f"pose-{p}-{s if own_poses else ''}")
        for s in range(n_subjects)
        for p in range(n_poses)
    )
    return ShapeSet(name="rods", shapes=shapes, load=load, half_width=half_width)


def pixels(sheet):
    return np.asarray(sheet.image.convert("RGB"))


def chunks(content):
    """Names of the chunks of a PNG file."""
    names, place = [], 8
    while place < len(content):
        (length,) = struct.unpack(">I", content[place : place + 4])
        names.append(content[place + 4 : place + 8])
        place += length + 12
    return names


def test_the_canonical_pose_leads(tmp_path):
    write_rods(tmp_path)
    (tmp_path / "dataset.toml").write_text('canonical_pose = { thick = "2" }\n')
    dataset = folder_set(tmp_path)
    shown = {row[0].subject: [entry.pose for entry in row] for row in select(dataset, dataset.shapes, None, 3)}
    assert [pose[-1] for pose in shown["thick"]] == ["2", "0", "1"]
    assert [pose[-1] for pose in shown["thin"]] == ["0", "1", "2"]


@pytest.mark.parametrize(("subjects", "poses"), [(1, 1), (3, 4), (2, 12)])
def test_the_sheet_fits_the_width_and_is_white_around(subjects, poses):
    image = pixels(contact_sheet(rods(subjects, poses), None, poses))
    assert image.shape[1] <= WIDTH
    for edge in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert (edge == 255).all()


def test_a_shape_that_cannot_be_read_is_crossed_out_and_reported():
    whole, broken = contact_sheet(rods()), contact_sheet(rods(broken="1-2"))
    assert whole.problems == ()
    assert broken.problems == ("1-2: the file is cut off; copy it again",)
    corners = [pixels(sheet)[-sheets._MARGIN, -sheets._MARGIN] for sheet in (whole, broken)]
    assert (corners[0] == 255).all()
    assert corners[1].astype(int) == pytest.approx(sheets._FAINT, abs=8)


def test_shapes_beyond_the_frame_are_crossed_out_and_reported():
    problems = contact_sheet(rods(half_width=0.3)).problems
    assert problems
    assert all("of the half width 0.3 of the camera's frame" in problem for problem in problems)


def test_the_same_sheet_is_the_same_file(tmp_path):
    for name in ("a.png", "sub/b.PNG"):
        save_png(contact_sheet(rods()).image, tmp_path / name)
    first = (tmp_path / "a.png").read_bytes()
    assert first == (tmp_path / "sub" / "b.PNG").read_bytes()
    assert set(chunks(first)) <= {b"IHDR", b"PLTE", b"IDAT", b"IEND"}


def test_other_names_and_places_that_cannot_be_written_are_refused(tmp_path):
    sheet = contact_sheet(rods(1, 1))
    with pytest.raises(BenchmarkError, match=r"\.png"):
        save_png(sheet.image, tmp_path / "sheet.pdf")
    (tmp_path / "file").write_text("")
    with pytest.raises(BenchmarkError, match="-o"):
        save_png(sheet.image, tmp_path / "file" / "sheet.png")


def test_the_verb_writes_the_sheet_of_a_folder(tmp_path):
    write_rods(tmp_path / "rods")
    (tmp_path / "rods" / "thin9.off").write_text("OFF\n3 1 0\n0 0 0\n")
    target = tmp_path / "sheet.png"
    done = CliRunner().invoke(data, ["sheet", str(tmp_path / "rods"), "-o", str(target), "--poses", "9"])
    assert done.exit_code == 0, done.output
    assert done.stdout == f"wrote {target}\n"
    assert "not drawn: thin9" in done.stderr
    with Image.open(target) as image:
        assert image.format == "PNG"
        assert image.mode == "P"


@pytest.mark.data
def test_people_of_tosca_face_the_camera_and_animals_look_to_the_right(data_root):
    """Toes lie in front of the heels; the muzzle lies to the right of the root of the tail."""
    dataset = open_dataset("tosca", data_root)
    for row in select(dataset, dataset.shapes, None, 1):
        points = dataset.load(row[0]).vertices @ dataset.camera(row[0]).rotation.T
        low, high = points.min(axis=0), points.max(axis=0)
        if row[0].subject in ("david", "gorilla", "michael", "victoria"):
            height = (points[:, 1] - low[1]) / (high - low)[1]
            feet, shins = points[height < 0.03], points[(height > 0.08) & (height < 0.2)]
            assert feet[:, 2].max() - np.median(shins[:, 2]) > np.median(shins[:, 2]) - feet[:, 2].min()
        else:
            top = points[points[:, 1] > high[1] - 0.1 * (high - low)[1]]
            assert np.median(top[:, 0]) > (low + high)[0] / 2

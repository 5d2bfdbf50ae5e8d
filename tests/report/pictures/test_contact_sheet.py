import struct
from dataclasses import dataclass

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from benchmark.cli.verbs.data import data
from benchmark.datasets.base import Entry
from benchmark.datasets.folder import folder_dataset
from benchmark.datasets.official.tosca import tosca
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.mesh import Mesh
from benchmark.report.pictures import contact_sheet as sheets
from benchmark.report.pictures.contact_sheet import WIDTH, contact_sheet, select
from tests.toy import rod, write_rods


@dataclass(frozen=True)
class Rods:
    """Bent rods of any number of builds and poses; every shape may be made another one or unreadable."""

    n_subjects: int = 2
    n_poses: int = 3
    own_poses: bool = False
    broken: str = ""
    name: str = "rods"
    title: str = "Rods"
    stand_in_for: str = ""
    half_width: float | None = 1.0

    @property
    def entries(self):
        return tuple(
            Entry(f"{s}-{p}", f"subject-{s}", f"pose-{p}-{s if self.own_poses else ''}")
            for s in range(self.n_subjects)
            for p in range(self.n_poses)
        )

    def load(self, entry):
        if entry.identifier == self.broken:
            raise UnreadableMesh("the file is cut off", "copy it again")
        subject, pose = map(int, entry.identifier.split("-"))
        return rod(0.05 + 0.02 * subject, 0.5 * pose)

    def recipe(self, entry):
        return entry.identifier

    def camera(self, entry):
        return FRONT


def identifiers(rows):
    return [[entry.identifier for entry in row] for row in rows]


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


def test_shapes_are_spread_evenly():
    rows = select(Rods(n_subjects=7, n_poses=10), 3, 4)
    assert identifiers(rows) == [[f"{s}-{p}" for p in (0, 3, 6, 9)] for s in (0, 3, 6)]
    assert identifiers(select(Rods(), None, 1)) == [["0-0"], ["1-0"]]


def test_more_than_there_is_shows_all_once():
    assert identifiers(select(Rods(n_subjects=2, n_poses=3), 9, 9)) == [["0-0", "0-1", "0-2"], ["1-0", "1-1", "1-2"]]


def test_the_canonical_pose_leads(tmp_path):
    write_rods(tmp_path)
    (tmp_path / "dataset.toml").write_text('canonical_pose = { thick = "2" }\n')
    shown = {row[0].subject: [entry.pose for entry in row] for row in select(folder_dataset(tmp_path), None, 3)}
    assert [pose[-1] for pose in shown["thick"]] == ["2", "0", "1"]
    assert [pose[-1] for pose in shown["thin"]] == ["0", "1", "2"]


@pytest.mark.parametrize(("subjects", "poses"), [(0, 3), (2, 0), (-1, 3)])
def test_a_sheet_of_nothing_is_refused(subjects, poses):
    with pytest.raises(ConfigurationError, match="positive"):
        select(Rods(), subjects, poses)


def test_an_empty_set_is_refused():
    with pytest.raises(DatasetError, match="no meshes"):
        select(Rods(n_subjects=0), None, 3)


def test_too_many_poses_are_refused():
    with pytest.raises(ConfigurationError, match="fewer poses"):
        contact_sheet(Rods(n_subjects=1, n_poses=60), None, 60)


@pytest.mark.parametrize(("subjects", "poses"), [(1, 1), (3, 4), (2, 12)])
def test_the_sheet_fits_the_width_and_is_white_around(subjects, poses):
    image = pixels(contact_sheet(Rods(subjects, poses), None, poses))
    assert image.shape[1] <= WIDTH
    for edge in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert (edge == 255).all()


def test_white_borders_are_all_that_is_cropped():
    for dataset in (Rods(3, 6), Rods(2, 12)):
        rows = select(dataset, None, 12)
        sights = {e.identifier: sheets._Sight(dataset.load(e), FRONT, 1.0) for row in rows for e in row}
        layout = sheets._Layout.of(rows, sights)
        assert layout.aside == (dataset.n_poses == 6)
        for i, row in enumerate(rows):
            for j, entry in enumerate(row):
                pictures = sights[entry.identifier].pictures(layout.aside, layout.size)
                for picture, width in zip(pictures, layout.widths[j], strict=True):
                    whole = np.round(255 * picture) < 255
                    kept = np.asarray(sheets._cropped(picture, width, layout.heights[i])) < 255
                    assert kept.sum() == whole.sum() > 0


def test_the_three_quarter_view_looks_down_from_where_the_head_is():
    # An animal that faces -y has its head on the right of the side camera's picture.
    direction = np.array(sheets._three_quarter(SIDE).direction)
    assert direction @ SIDE.direction > 0.5
    assert direction[1] > 0.3
    assert direction[2] < 0


def test_depth_pictures_share_the_scale_of_the_set_and_surfaces_fill_theirs():
    small, large = (sheets._Sight(Mesh(s * rod(0.1, 0).vertices, rod(0.1, 0).faces), FRONT, 2.0) for s in (1, 2))
    widths = [[np.ptp(np.nonzero((p < 1).any(axis=(0, 2)))[0]) for p in s.pictures(False, 100)] for s in (small, large)]
    assert widths[0][0] == widths[1][0] > 85
    assert widths[1][1] == pytest.approx(2 * widths[0][1], abs=3)


def test_poses_are_named_once_where_all_rows_share_them():
    same, own = contact_sheet(Rods()), contact_sheet(Rods(own_poses=True))
    assert own.image.height - same.image.height == sheets._LINE


def test_a_shape_that_cannot_be_read_is_crossed_out_and_reported():
    whole, broken = contact_sheet(Rods()), contact_sheet(Rods(broken="1-2"))
    assert whole.problems == ()
    assert broken.problems == ("1-2: the file is cut off; copy it again",)
    corners = [pixels(sheet)[-sheets._MARGIN, -sheets._MARGIN] for sheet in (whole, broken)]
    assert (corners[0] == 255).all()
    assert corners[1] == pytest.approx(sheets._FAINT, abs=8)


def test_shapes_beyond_the_frame_are_crossed_out_and_reported():
    problems = contact_sheet(Rods(half_width=0.3)).problems
    assert problems
    assert all("of the half width 0.3 of the camera's frame" in problem for problem in problems)


def test_a_set_without_a_frame_gets_the_one_that_fits_all_shapes():
    # The straight rod is the longest, so the sheet of one bent pose must know the others.
    fitted = contact_sheet(Rods(half_width=None, n_subjects=1), None, 2)
    extent = np.ptp(rod(0.05, 0).vertices[:, 0]) / 2
    declared = contact_sheet(Rods(half_width=float(extent / 0.9), n_subjects=1), None, 2)
    assert (pixels(fitted) == pixels(declared)).all()


def test_the_same_sheet_is_the_same_file(tmp_path):
    for name in ("a.png", "sub/b.PNG"):
        contact_sheet(Rods()).save(tmp_path / name)
    first = (tmp_path / "a.png").read_bytes()
    assert first == (tmp_path / "sub" / "b.PNG").read_bytes()
    assert set(chunks(first)) <= {b"IHDR", b"PLTE", b"IDAT", b"IEND"}


def test_the_palette_changes_shades_by_little(monkeypatch):
    few = pixels(contact_sheet(Rods())).astype(int)
    monkeypatch.setattr(Image.Image, "quantize", lambda self, *_, **__: self)
    assert np.abs(few - pixels(contact_sheet(Rods()))).max() <= 8
    assert (few == 255).all(axis=2).mean() > 0.5


def test_other_names_and_places_that_cannot_be_written_are_refused(tmp_path):
    sheet = contact_sheet(Rods(1, 1))
    with pytest.raises(BenchmarkError, match=r"\.png"):
        sheet.save(tmp_path / "sheet.pdf")
    (tmp_path / "file").write_text("")
    with pytest.raises(BenchmarkError, match="-o"):
        sheet.save(tmp_path / "file" / "sheet.png")


def test_long_names_are_shortened():
    short = sheets._shortened("an-exceedingly-long-name-of-a-pose", 80)
    assert short.startswith("an-ex")
    assert short.endswith("…")
    assert sheets._text_width(short) <= 80
    assert sheets._shortened("pose", 80) == "pose"


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
    dataset = tosca(data_root)
    for row in select(dataset, None, 1):
        points = dataset.load(row[0]).vertices @ dataset.camera(row[0]).rotation.T
        low, high = points.min(axis=0), points.max(axis=0)
        if row[0].subject in ("david", "gorilla", "michael", "victoria"):
            height = (points[:, 1] - low[1]) / (high - low)[1]
            feet, shins = points[height < 0.03], points[(height > 0.08) & (height < 0.2)]
            assert feet[:, 2].max() - np.median(shins[:, 2]) > np.median(shins[:, 2]) - feet[:, 2].min()
        else:
            top = points[points[:, 1] > high[1] - 0.1 * (high - low)[1]]
            assert np.median(top[:, 0]) > (low + high)[0] / 2

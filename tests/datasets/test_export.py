from dataclasses import replace

import pytest

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.changes import split_changes, with_change
from benchmark.datasets.export import write_meshes
from benchmark.datasets.folder import folder_set
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.geometry.camera import FRONT, SIDE
from tests.toy import rod, write_rods

SUBJECTS = ("man-2", "cat", "man-1")
POSES = ("stand", "sit", "7")


def beasts(**changes):
    """Generated shapes with awkward names; classes lie between each other."""
    known = ShapeSet(
        name="beasts",
        stand_in_for="tosca",
        half_width=1.3,
        shapes=tuple(Entry(f"{s}_{p}", s, p) for p in POSES for s in SUBJECTS),
        load=lambda entry: rod(
            0.05 + 0.03 * SUBJECTS.index(entry.subject), 0.7 * POSES.index(entry.pose)
        ),
        camera=lambda entry: SIDE if entry.subject == "cat" else FRONT,
    )
    return replace(known, **changes)


@pytest.mark.parametrize("changes", ["", "[noise=1][view-angle=4]"])
def test_shapes_cameras_and_canonical_poses_come_back(tmp_path, changes):
    source = beasts(canonical_poses={"cat": "sit"})
    for change, level in split_changes(f"beasts{changes}")[1]:
        source = with_change(source, change, level)
    written, problems = write_meshes(source, tmp_path / "out")
    back = folder_set(tmp_path / "out")
    names = [str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*")]
    assert (sorted(written), problems) == (sorted(names), [])
    assert (back.half_width, back.stand_in_for) == (1.3, "tosca")
    canonical = {subject: entry.pose for subject, entry in canonical_shapes(back).items()}
    assert canonical == {"cat": "sit", "man-1": "stand", "man-2": "stand"}
    exported = {(entry.subject, entry.pose): entry for entry in back.shapes}
    for before in source.shapes:
        after = exported[before.subject, before.pose]
        assert back.camera(after).direction == pytest.approx(
            source.camera(before).direction, abs=1e-15
        )
        first, second = source.load(before), back.load(after)
        assert first.vertices.tobytes() == second.vertices.tobytes()
        assert first.faces.tobytes() == second.faces.tobytes()


def test_depth_noise_is_no_part_of_a_mesh(tmp_path):
    with pytest.raises(
        ConfigurationError, match="meshes have no depth noise; export the set without it"
    ):
        write_meshes(with_change(beasts(), "depth-noise", 5), tmp_path / "out")


def test_each_shape_has_a_file_of_its_own_whatever_the_poses_are_called(tmp_path):
    """Equal poses get the numbers of their shapes, which other poses may hold."""
    poses = ("sit", "Sit", "sit-1", "", "pose-3", "sit-0", "Sit-0")
    entries = tuple(Entry(str(n), "cat", pose) for n, pose in enumerate(poses))
    source = beasts(shapes=entries, load=lambda _: rod(0.05, 0))
    written, _ = write_meshes(source, tmp_path / "out")
    assert len({name.casefold() for name in written}) == len(poses) + 1
    assert len(folder_set(tmp_path / "out").shapes) == len(poses)


def test_a_set_without_a_readable_mesh_leaves_no_folder(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "cat0.off").write_text("OFF 1")
    with pytest.raises(DatasetError, match="no mesh of 'in' is readable: cat0: "):
        write_meshes(folder_set(tmp_path / "in"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_with_files_is_left_alone(tmp_path):
    write_rods(tmp_path / "in")
    before = {path.name: path.read_bytes() for path in (tmp_path / "in").iterdir()}
    with pytest.raises(ConfigurationError, match="in is not an empty folder; choose a new one"):
        write_meshes(open_dataset(f"{tmp_path}/in[noise=5]"), tmp_path / "in")
    assert before == {path.name: path.read_bytes() for path in (tmp_path / "in").iterdir()}
    (tmp_path / "out").mkdir()
    write_meshes(beasts(), tmp_path / "out")
    assert len(folder_set(tmp_path / "out").shapes) == 9
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "out"]


def test_a_set_is_not_exported_into_itself_or_over_a_link(tmp_path):
    rods = write_rods(tmp_path / "in")
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    (rods / "part").symlink_to(tmp_path)
    for name, reason in (
        ("in/new", "in/new lies in the data set, whose shapes it would join"),
        ("in/part/in/new", "lies in the data set"),
        ("link", "link is not an empty folder"),
    ):
        with pytest.raises(ConfigurationError, match=reason):
            write_meshes(open_dataset(f"{rods}[noise=5]"), tmp_path / name, watched=None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "link"]


@pytest.mark.parametrize(
    ("subject", "pose", "message"),
    [
        ("../cat", "0", "'../cat' of 'x' cannot be the name of a file"),
        ("cat", "a\tb", "cannot be the name of a file"),
    ],
)
def test_names_that_files_cannot_carry_are_named(tmp_path, subject, pose, message):
    entries = (Entry("x", subject, pose), Entry("y", subject, "1"))
    with pytest.raises(ConfigurationError, match=message):
        write_meshes(beasts(shapes=entries), tmp_path / "out")

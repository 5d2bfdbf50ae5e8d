"""Changes do what they say, the same each time; a higher level is more of the same."""

import contextlib
import tracemalloc

import numpy as np
import pytest
from trimesh import Trimesh

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.changes import split_changes, with_change
from benchmark.datasets.surface_changes import holes, seen_from_near, shortcuts
from benchmark.errors import ConfigurationError, UnsupportedShape
from benchmark.geometry.camera import FRONT, SIDE
from benchmark.geometry.cleaning import extent_of
from tests.geometry.surfaces import sphere
from tests.toy import rod, write_rods

BALL = sphere(3)
HORSESHOE = rod(0.05, 4.5, rings=60)


def random():
    return np.random.default_rng(0)


def as_trimesh(mesh):
    return Trimesh(mesh.vertices, mesh.faces, process=False)


def test_a_shortcut_joins_the_ends_of_a_horseshoe_and_adds_a_handle_each():
    assert as_trimesh(HORSESHOE).euler_number == 2
    glued = shortcuts(HORSESHOE, 1, random())
    tube = as_trimesh(glued)
    assert tube.is_watertight and tube.is_winding_consistent
    assert tube.euler_number == 0
    added = glued.faces[HORSESHOE.n_faces - 2 :].ravel()
    along = np.unique(added) // 12  # ring of each corner
    assert along.min() < 15 and along.max() > 45  # from one arm to the other
    with pytest.raises(UnsupportedShape, match="comes near itself at 0 places"):
        shortcuts(rod(0.05, 0.0), 1, random())  # a straight rod has no two parts


def test_a_further_shortcut_keeps_a_distance_from_where_an_earlier_one_begins():
    mesh = rod(0.05, 4.5, rings=120, sides=24)
    glued = shortcuts(mesh, 2, random())
    first, second = glued.faces[mesh.n_faces - 4 :].reshape(2, 6, 3)
    # The first corners of every second triangle of a tube are those at which it begins.
    begin = mesh.vertices[first[::2, 0]].mean(axis=0)
    apart = np.linalg.norm(mesh.vertices[np.unique(second)] - begin, axis=1)
    assert apart.min() > 0.05 * extent_of(mesh)


def test_names_are_split_once_and_levels_are_checked(tmp_path, monkeypatch):
    assert split_changes("a set[noise=3][jitter=9]") == ("a set", [("noise", 3), ("jitter", 9)])
    assert split_changes("people[draw=1][view-angle=2]") == ("people[draw=1]", [("view-angle", 2)])
    for name in ("people[noise=6]", "people[noise=0]", "people[noise=x]", "people[jitter=10]"):
        with pytest.raises(
            ConfigurationError, match="has no level '.*'; choose a whole number from 1 to [59]"
        ):
            split_changes(name)
    monkeypatch.chdir(tmp_path)
    write_rods(tmp_path / "scans[jitter=1]")
    assert split_changes("scans[jitter=1][noise=2]") == ("scans[jitter=1]", [("noise", 2)])
    assert open_dataset("scans[jitter=1]").name == "scans[jitter=1]"


def test_changes_add_up_and_a_camera_is_changed_for_views_alone(rods, tmp_path):
    noise = open_dataset(f"{rods}[depth-noise=5]")
    both = open_dataset(f"{rods}[noise=2][depth-noise=5][view-angle=5]")
    entry = both.shapes[0]
    assert both.sensor(entry) == noise.sensor(entry) is not None
    assert np.cos(np.radians(60)) <= np.dot(both.camera(entry).direction, FRONT.direction) < 1
    assert (both.inputs, open_dataset(f"{rods}[noise=2]").inputs) == (("view",), ("mesh", "view"))
    with pytest.raises(ConfigurationError, match="has depth noise already"):
        open_dataset(f"{rods}[depth-noise=5][depth-noise=1]")
    folder = write_rods(tmp_path / "posed", bends=(0.0, 1.0))
    (folder / "dataset.toml").write_text('[canonical_pose]\nthick = "1"\n')
    for change in ("", "[noise=1]", "[noise=1][jitter=1]"):
        assert canonical_shapes(open_dataset(f"{folder}{change}"))["thick"].identifier == "thick1"


def test_views_are_made_of_what_makes_their_shape(tmp_path):
    """A set of a user may know its shapes by name alone."""
    made_of = {"rod": tmp_path / "rod.off"}
    shapes = ShapeSet(
        name="rods",
        shapes=(Entry("rod", "rod", ""),),
        load=lambda _: BALL,
        key=lambda entry: str(made_of[entry.identifier]),
        files=lambda entry: [made_of[entry.identifier]],
        code=lambda entry: (made_of[entry.identifier].stem,),
    )
    views = with_change(shapes, "cameras-and-own", 2)
    assert len(views.shapes) == 3
    for view in views.shapes:
        assert views.load(view) is BALL
        assert views.key(view) == str(made_of["rod"])
        assert views.files(view) == [made_of["rod"]]
        assert views.code(view)[0] == "rod"


@pytest.mark.parametrize("camera", [FRONT, SIDE])
def test_a_perspective_camera_sees_less_the_nearer_it_is_and_what_it_sees_lies_on_the_shape(camera):
    moved = BALL.with_vertices(3 * BALL.vertices + [5, 6, 7])
    areas = []
    for distance in (3.0, 1.0):
        seen = seen_from_near(moved, camera, distance)
        radii = np.linalg.norm(seen.vertices - [5, 6, 7], axis=1)
        assert radii.min() > 2.9 and radii.max() < 3.001
        heights = (seen.vertices - [5, 6, 7]) @ -np.asarray(camera.direction) / 3
        assert heights.min() == pytest.approx(
            1 / (2 * distance), abs=0.05
        )  # tangents to a ball of extent 2
        areas.append(seen.area)
        a, b, c = (seen.vertices[seen.faces[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a) @ np.asarray(camera.direction) < 0).mean() > 0.99
    assert areas[0] > areas[1]


def test_changes_of_large_meshes_take_little_memory():
    ball = sphere(6)
    for change in (holes, shortcuts):
        tracemalloc.start()
        with contextlib.suppress(UnsupportedShape):  # a ball does not come near itself
            change(ball, 5, random())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1000 * ball.n_vertices, change

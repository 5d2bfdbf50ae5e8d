"""Python finds the shapes that the verb prints, for a file and for the mesh of another library."""

import shlex
import shutil
from types import SimpleNamespace

import numpy as np
import pandas.testing
import pytest
import trimesh
from PIL import Image

import benchmark
from benchmark.errors import ConfigurationError, UnreadableMesh
from benchmark.pipeline.record_files import read_records
from tests.behaviour.suite import write_frames as write_ellipsoid_frames
from tests.datasets.test_frames import write_frames
from tests.runs.toy import without_processes
from tests.toy import SMALL_SCORER, rod, write_rods
from tests.verbs import call, refusal

QUERY = "thick1.off"


@pytest.fixture(scope="module")
def gallery(rods, tmp_path_factory):
    """What names a finished gallery of rods: its folder, method, scorer and results."""
    results = tmp_path_factory.mktemp("retrieve") / "results"
    selected = ("-d", rods, "-m", "gps", "--scorer", SMALL_SCORER, "--results", results)
    with without_processes():
        call("run", *selected, "-j", 0)
    return SimpleNamespace(data=rods, method="gps", scorer=SMALL_SCORER, results=results)


def found(query, gallery, **options):
    """Return the matches of a query in the gallery."""
    return benchmark.retrieve(
        query,
        gallery.data,
        gallery.method,
        scorer=gallery.scorer,
        results=gallery.results,
        **options,
    )


def test_matches_are_those_that_the_verb_prints(gallery):
    query = gallery.data / QUERY
    matches = found(query, gallery, count=4)
    selected = ("-d", gallery.data, "-m", gallery.method, "--scorer", gallery.scorer)
    printed = call("retrieve", *selected, "--results", gallery.results, "-k", 4, query)
    rows = [line.split() for line in printed.splitlines()]
    for match in matches.frame.itertuples(index=False):
        words = [str(match.rank), match.name]
        assert any(row[: len(words)] == words for row in rows), printed
    assert matches.decision in printed.replace("\n", " ")
    assert "thick1" not in set(matches.frame["name"]), "the query is no answer to itself"


def test_a_mesh_of_another_library_finds_what_a_copy_of_its_file_finds(gallery, tmp_path):
    copy = shutil.copy(gallery.data / QUERY, tmp_path)
    of_file = found(copy, gallery)
    assert of_file.frame["name"][0] == "thick1"
    assert "the gallery holds the query, or its copy" in of_file.notes[0]
    body = trimesh.load(copy, process=False)
    for query in (body, (body.vertices, body.faces)):
        matches = found(query, gallery)
        pandas.testing.assert_frame_equal(matches.frame, of_file.frame)
        assert matches.decision == of_file.decision


@pytest.mark.parametrize(
    ("settings", "input"),
    [
        ('unit = "mm"', "mesh"),
        ('normalise = "area"', "mesh"),
        ('unit = "mm"', "view"),
        ('up = "y"', "view"),
        ('camera = "side"\n[canonical_pose]\nthick = "1"', "view"),
    ],
)
def test_a_new_mesh_has_the_unit_and_the_camera_of_the_folder(tmp_path, settings, input):
    """The area of a surface, or of a view of it, tells whether size and camera are right."""
    folder = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    (folder / "dataset.toml").write_text(settings)
    results = tmp_path / "results"
    selected = ("-d", folder, "-m", "surface-area", "--input", input, "--results", results)
    with without_processes():
        call("run", *selected, "-j", 0)
    copy = shutil.copy(folder / QUERY, tmp_path)
    for query in (copy, trimesh.load(copy, process=False)):
        matches = benchmark.retrieve(query, folder, "surface-area", input=input, results=results)
        assert matches.frame["name"][0] == "thick1"
        assert matches.frame["distance"][0] == pytest.approx(0, abs=1e-12)


ORB_SLAM = (
    "%YAML:1.0\nCamera.fx: 262.5\nCamera.fy: 262.5\nCamera.cx: 159.75\nCamera.cy: 119.75\n"
    "DepthMapFactor: 5000.0\n"
)


@pytest.mark.parametrize(
    ("file", "text"), [("dataset.toml", "depth_scale = 5000"), ("camera.yaml", ORB_SLAM)]
)
def test_a_new_frame_is_asked_for_its_unit_where_the_gallery_states_another(tmp_path, file, text):
    folder = write_frames(tmp_path / "frames")
    for image in folder.glob("*/?.png"):  # millimetres become fifths of them
        Image.fromarray(5 * np.asarray(Image.open(image))).save(image)
    shutil.copy(folder / "intrinsics.txt", tmp_path)
    if file == "camera.yaml":
        (folder / "intrinsics.txt").unlink()
    (folder / file).write_text(text)
    results = tmp_path / "results"
    with without_processes():
        call("run", "-d", folder, "-m", "surface-area", "--results", results, "-j", 0)
    new = shutil.copy(folder / "one" / "0.png", tmp_path / "new.png")
    shutil.copy(folder / "one" / "0_mask.png", tmp_path / "new_mask.png")
    said = refusal("retrieve", "-d", folder, "-m", "surface-area", "--results", results, new)
    assert "have 5000 units per metre, and nothing states those of" in said.replace("\n", " ")
    matches = benchmark.retrieve(new, folder, "surface-area", results=results, depth_scale=5000)
    assert matches.frame["name"][0] == "one/0"
    assert matches.frame["distance"][0] == pytest.approx(0, abs=1e-12)


def test_a_new_frame_of_millimetres_needs_no_unit_where_the_gallery_states_millimetres(tmp_path):
    folder = write_frames(tmp_path / "frames")
    (folder / "dataset.toml").write_text("depth_scale = 1000")
    results = tmp_path / "results"
    with without_processes():
        call("run", "-d", folder, "-m", "surface-area", "--results", results, "-j", 0)
    new = shutil.copy(folder / "two" / "1.png", tmp_path / "new.png")
    shutil.copy(folder / "two" / "1_mask.png", tmp_path / "new_mask.png")
    shutil.copy(folder / "intrinsics.txt", tmp_path)
    matches = benchmark.retrieve(new, folder, "surface-area", results=results)
    assert matches.frame["name"][0] == "two/1"
    assert matches.frame["distance"][0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("up", "notes"), [("[1, 0, 0]", 1), ("[0, -1, 0]", 0)])
def test_a_new_frame_without_a_floor_has_the_up_direction_of_the_folder(tmp_path, up, notes):
    folder = tmp_path / "frames"
    write_ellipsoid_frames(folder)
    (folder / "dataset.toml").write_text(f"up = {up}")
    results = tmp_path / "results"
    with without_processes():
        call("run", "-d", folder, "-m", "surface-area", "--results", results, "-j", 0)
    new = shutil.copy(folder / "stout1.npy", tmp_path / "new.npy")
    shutil.copy(folder / "intrinsics.txt", tmp_path)
    matches = benchmark.retrieve(new, folder, "surface-area", results=results)
    assert matches.frame["name"][0] == "stout1"
    assert matches.frame["distance"][0] == pytest.approx(0, abs=1e-12)
    assert sum("shows no floor" in note for note in matches.notes) == notes


def test_a_mesh_that_no_file_holds_is_found_beside_its_own_build(gallery):
    matches = found(rod(0.18, 0.6), gallery, count=2)
    assert matches.name == "the query"
    assert set(matches.frame["class"]) == {"thick"}
    assert not matches.notes


def test_a_gallery_without_forms_is_refused_in_the_words_of_the_verb(gallery, tmp_path):
    query = gallery.data / QUERY
    with pytest.raises(ConfigurationError) as error:
        benchmark.retrieve(query, gallery.data, "gps", results=tmp_path)
    said = refusal("retrieve", "-d", gallery.data, "-m", "gps", "--results", tmp_path, query)
    assert str(error.value).splitlines()[0].split(";")[0] in said.replace("\n", " ")
    own = ("--seed", "3", "--results", tmp_path, "--data-root", gallery.data)
    words = ("-d", gallery.data, "-m", "gps", *own, query)
    command = refusal("retrieve", *words).partition("run `")[2].partition("` first")[0]
    assert "1 of 1 jobs to run" in call("plan", *shlex.split(command)[4:])
    assert f"--results {tmp_path} --data-root {gallery.data} --seed 3" in command


def test_a_gallery_of_which_a_form_is_gone_is_refused_and_not_searched_in_part(gallery, tmp_path):
    results = shutil.copytree(gallery.results, tmp_path / "results")
    part = SimpleNamespace(**{**vars(gallery), "results": results})
    query = shutil.copy(gallery.data / QUERY, tmp_path)
    assert len(found(query, part, count=9).frame) == 4
    (record,) = (record for record in read_records(results) if record.input == "mesh")
    first, second, *_ = record.files["signatures"]
    (results / "runs" / "signatures" / f"{first}.npz").unlink()
    (results / "runs" / "signatures" / f"{second}.npz").write_bytes(b"PK")
    with pytest.raises(ConfigurationError, match=r"2 of 4 forms of rods are not kept in .*results"):
        found(query, part)
    selected = ("-d", part.data, "-m", part.method, "--scorer", part.scorer)
    with without_processes():
        call("run", *selected, "--results", results, "-j", 0, "--force")
    assert len(found(query, part, count=9).frame) == 4


@pytest.mark.parametrize(
    "camera", [{"intrinsics": "525,525,319,239"}, {"mask": "mask.png"}, {"depth_scale": 1000.0}]
)
def test_a_mesh_has_no_camera(gallery, tmp_path, camera):
    copy = shutil.copy(gallery.data / QUERY, tmp_path)
    for query in (gallery.data / QUERY, copy, rod(0.18, 0.6)):
        with pytest.raises(ConfigurationError, match="is a mesh, not a depth image"):
            found(query, gallery, **camera)


def test_a_query_that_is_not_there_is_named(gallery, tmp_path):
    with pytest.raises(UnreadableMesh, match=r"none\.off: No such file or directory"):
        found(tmp_path / "none.off", gallery)

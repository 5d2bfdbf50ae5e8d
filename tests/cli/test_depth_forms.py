"""``canonicalise`` of depth images, and ``retrieve``."""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

from benchmark import code_digest
from benchmark.commands.retrieve import _with_model
from benchmark.errors import ConfigurationError
from benchmark.pipeline.search import SearchResult
from tests.datasets.test_frames import write_frames
from tests.runs.toy import without_processes
from tests.toy import SMALL_SCORER
from tests.verbs import call, refusal

#: Runs start no processes: each would import torch anew.
pytestmark = pytest.mark.usefixtures("in_this_process")


def test_a_folder_and_a_pattern_give_a_form_of_each_image_and_one_bad_image_costs_one(tmp_path):
    folder = write_frames(tmp_path / "frames")
    (folder / "one" / "1.png").write_bytes(b"")
    words = (
        "canonicalise",
        "-m",
        "identity",
        folder,
        "-o",
        tmp_path / "forms",
        "--picture",
        tmp_path / "pictures",
    )
    told = call(*words, code=1)
    assert [line.split("  ")[0] for line in told.splitlines()[:4]] == [
        f"{n} of 4" for n in range(1, 5)
    ]
    assert "one/1.png: not a readable png file" in told
    assert "1 of 4 images have no form" in told
    made = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.off")}
    assert made == {"forms/one/0.off", "forms/two/0.off", "forms/two/1.off"}
    assert len(list((tmp_path / "pictures").rglob("*.png"))) == 3
    others = sorted((folder / "two").glob("0*.png"))  # a mask and a colour image are among them
    said = call("canonicalise", "-m", "identity", *others, "-o", tmp_path / "form.off")
    facts = (
        r"distance 2\.\d+ m, size 1\.\d+ m, unit assumed 1 / 1000 m, camera \.\./intrinsics\.txt$"
    )
    assert re.search(f"form.off: .*, mask 0_mask.png, .*, {facts}", said)


def test_no_picture_is_written_over_a_file_that_is_read(tmp_path):
    folder = write_frames(tmp_path / "frames", count=1)
    before = {path: path.read_bytes() for path in folder.rglob("*.*")}
    image = folder / "two" / "0.png"
    mask = folder / "two" / "0_mask.png"
    form = ("-o", tmp_path / "form.off", "--picture")
    for words, replaced in (
        ((image, *form, image), image),
        ((image, *form, mask), mask),
        ((image, "--mask", image, *form, image), image),
        ((folder, "-o", tmp_path / "forms", "--picture", folder), image),
    ):
        said = refusal("canonicalise", "-m", "identity", *words)
        assert f"{replaced.name} would be replaced: it is read; write to another" in said
    words = ("retrieve", "-m", "identity", "-d", folder, image, "--picture", image)
    assert f"{image} would be replaced" in refusal(*words)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def test_the_forms_of_two_images_are_two_files(tmp_path):
    folder = write_frames(tmp_path / "frames", count=1)
    image = folder / "two" / "0.png"
    shutil.copy(image, folder / "two" / "0.tiff")
    words = ("canonicalise", "-m", "identity", image, image.with_suffix(".tiff"))
    said = refusal(*words, "-o", tmp_path / "forms")
    assert (
        f"two/0.png and {image.with_suffix('.tiff')} would both be {tmp_path}/forms/0.off" in said
    )
    assert not (tmp_path / "forms").exists()


def test_the_settings_of_a_folder_hold_for_its_images_unless_the_command_line_has_others(tmp_path):
    folder = write_frames(tmp_path / "frames", count=1)
    (folder / "intrinsics.txt").unlink()
    (folder / "dataset.toml").write_text(
        "intrinsics = [262.5, 262.5, 159.75, 119.75]\nhalf_width = 1\ndepth_scale = 500\n"
    )
    words = ("canonicalise", "-m", "identity", folder, "-o", tmp_path / "forms")
    assert call(*words, code=1).count("more than the 2.00 m of the frame") == 2
    assert call(*words, "--depth-scale", 1000).count(" vertices") == 2
    narrow = call(*words, "--depth-scale", 1000, "--intrinsics", "125,125,159.75,119.75", code=1)
    assert narrow.count("more than the 2.00 m of the frame") == 2


class Gallery(NamedTuple):
    """A folder of depth images that was run by two methods; none may write to it."""

    folder: Path
    results: Path

    def asked(self, query, method="identity", results=None):
        """Return the words that search it."""
        words = ("retrieve", "-m", method, "-d", self.folder, "--scorer", SMALL_SCORER)
        return (*words, "--results", results or self.results, query)


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    """Depth images whose camera stands in the settings of their folder alone."""
    folder = write_frames(tmp_path_factory.mktemp("gallery") / "frames")
    results = folder.parent / "results"
    (folder / "intrinsics.txt").unlink()
    (folder / "dataset.toml").write_text("intrinsics = [262.5, 262.5, 159.75, 119.75]\n")
    selected = ("-d", folder, "-m", "identity", "-m", "surface-area", "--scorer", SMALL_SCORER)
    with without_processes():
        call("run", *selected, "--results", results, "-j", "0")
    return Gallery(folder, results)


def test_a_gallery_that_was_run_is_searched(gallery, tmp_path):
    picture, query = tmp_path / "found.png", gallery.folder / "two" / "1.png"
    before_the_run = refusal(*gallery.asked(query, results=tmp_path / "results"))
    assert f"run -m identity -d {gallery.folder} --input view" in before_the_run
    asked = gallery.asked(query)
    first = call(*asked, "--picture", picture)
    assert first.splitlines()[0].split() == ["rank", "name", "class", "distance"]
    assert "two/1" not in first, "the query is no result"
    assert len(call(*asked, "-k", 2).splitlines()) == 4
    distances = [float(line.split()[-1]) for line in first.splitlines()[1:4]]
    assert distances == sorted(distances)
    with Image.open(picture) as drawn:
        assert drawn.width > drawn.height
    described = call(*gallery.asked(query, "surface-area"))
    assert re.search(r"(class (one|two), by|undecided: (one|two) has) a margin of", described)


def test_a_gallery_of_older_code_is_not_searched(gallery, monkeypatch):
    real = code_digest._parsed

    def edited(path):
        parsed = real(path)
        return parsed._replace(digest="e" * 16) if path.name == "identity.py" else parsed

    monkeypatch.setattr(code_digest, "_parsed", edited)
    stale = refusal(*gallery.asked(gallery.folder / "two" / "1.png"))
    assert (
        "the gallery is stale: identity.py changed; run `python -m benchmark run -m identity -d"
        in stale
    )


@pytest.mark.parametrize(
    ("margins", "is_decided"),
    [([0.1], True), ([0.1, 0.2, 0.1], True), ([-0.1, 0.2, 0.1], False), ([], False)],
)
def test_a_class_is_undecided_where_its_margin_lies_within_the_range_of_the_draws(
    margins, is_decided
):
    assert SearchResult([], None, np.array(margins)).is_decided is is_decided


def test_a_copy_of_a_shape_of_the_gallery_is_named(gallery, tmp_path):
    copy = shutil.copytree(gallery.folder, tmp_path / "copy")
    (copy / "intrinsics.txt").write_text("262.5 0 159.75\n0 262.5 119.75\n0 0 1\n")
    said = call(*gallery.asked(copy / "two" / "1.png"))
    assert "two/1 has the distance 0: the gallery holds the query, or its copy" in said


def test_a_query_takes_the_model_that_made_the_gallery():
    job = SimpleNamespace(
        models=(Path("a"), Path("b"), Path("b")),
        record=SimpleNamespace(gallery="g", shapes=[*"123"]),
    )
    learner = SimpleNamespace(create=lambda: SimpleNamespace(load=lambda folder: folder))
    assert [_with_model(learner, job, [name]) for name in "13"] == [Path("a"), Path("b")]
    with pytest.raises(
        ConfigurationError,
        match="the forms of g are of 2 models, and a query is in no fold; choose one",
    ):
        _with_model(learner, job, [])
    job.models = (Path("b"),) * 3
    assert _with_model(learner, job, []) == Path("b")


def test_a_query_of_the_gallery_is_prepared_with_its_settings(gallery):
    asked = gallery.asked(gallery.folder / "one" / "0.png")
    found = call(*asked)
    assert "two/0" in found
    same_camera = call(*asked, "--depth-scale", 1000)
    assert same_camera.splitlines()[:-1] == found.splitlines()[:-1]


def test_queries_warn_where_a_network_of_people_sees_something_small(tmp_path):
    folder = write_frames(tmp_path / "frames")
    small = ("--scorer", SMALL_SCORER, "--results", tmp_path / "results")
    selected = ("-m", "learned-streamed", "-d", folder, *small)
    call("run", *selected, "-j", 0)
    asked = ("retrieve", *selected, folder / "one" / "0.png")
    assert "small" not in call(*asked)
    said = call(*asked, "--depth-scale", 2500)
    assert re.search(r"0\.png: 0\.\d+ m is small for a person", said)

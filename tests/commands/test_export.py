"""``data export``: a generated set that others can download, check, cite and score."""

from __future__ import annotations

import csv
import hashlib
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.spatial import cKDTree

import benchmark
from benchmark.commands import export as exporting
from benchmark.datasets.folder import folder_set
from tests.toy import SMALL_SCORER, write_rods
from tests.verbs import call

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def animals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The exported set ``animals-few``."""
    folder = tmp_path_factory.mktemp("export") / "animals"
    call("data", "export", "animals-few", "--views", "-o", folder)
    return folder


def files_in(folder: Path) -> dict[str, bytes]:
    every = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in every}


def test_each_process_writes_the_same_bytes(animals, tmp_path):
    """Another process hashes texts in another way: nothing may follow the order of a set."""
    program = "import sys; from benchmark.commands.export import export; "
    program += "export('animals-few', sys.argv[1], views=True)"
    words = [sys.executable, "-c", program, str(tmp_path / "again")]
    subprocess.run(words, env=os.environ | {"PYTHONHASHSEED": "7"}, cwd=ROOT, check=True)
    assert files_in(tmp_path / "again") == files_in(animals)


def test_views_are_what_methods_get(animals):
    """Depths are those of prepared views but for rounding; the data sheet says where they lie."""
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.pipeline.prepared import frame_of
    from benchmark.pipeline.views import prepare_view

    shapes = open_dataset("animals-few")
    files = {(row["class"], row["pose"]): row["file"] for row in rows_of(animals / "shapes.csv")}
    cameras = {row["file"]: row for row in rows_of(animals / "views.csv")}
    assert len(cameras) == 18
    entry = shapes.shapes[4]
    camera = shapes.camera(entry)
    row = cameras[files[entry.subject, entry.pose]]
    half_width = float(row["half_width"])
    assert half_width == frame_of(shapes)
    direction = np.array([float(x) for x in row["direction"].split()])
    up = np.array([float(x) for x in row["up"].split()])
    assert np.allclose(direction, camera.direction, atol=1e-15)
    expected = prepare_view(shapes.load(entry), camera, half_width)["depth"]
    values = np.asarray(Image.open(animals / row["view"]))
    assert values.dtype == np.uint16 and values.shape == (500, 500)
    assert np.array_equal(values > 0, expected > 0)
    assert np.abs(values / 65535 - expected).max() <= 0.5 / 65535 + 1e-7

    rows, columns = np.nonzero(values)
    step = 2 * half_width / 500
    x = (columns + 0.5) * step - half_width
    y = half_width - (rows + 0.5) * step
    z = (2 * values[rows, columns].astype(float) / 65535 - 1) * half_width
    mesh = shapes.load(entry)
    frame = np.stack([np.cross(direction, up), up, -direction])
    corners = mesh.vertices @ frame.T
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    points = np.column_stack([x, y, z]) + centre
    away, _ = cKDTree(corners).query(points)
    assert np.median(away) < 3 * step


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table by the names of its columns."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_file_has_its_digest(animals):
    words = ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"]
    subprocess.run(words, cwd=animals, check=True)
    listed = {line.split("  ", 1)[1] for line in (animals / "SHA256SUMS").read_text().splitlines()}
    assert listed == files_in(animals).keys() - {"SHA256SUMS"}


def test_the_description_for_machines_is_valid_and_reads_the_shapes(animals):
    mlcroissant = pytest.importorskip("mlcroissant")
    dataset = mlcroissant.Dataset(jsonld=animals / "croissant.json")
    issues = dataset.metadata.ctx.issues
    assert issues.errors == set()
    assert issues.warnings == set()
    records = list(dataset.records("shapes"))
    assert len(records) == 18
    classes = Counter(record["shapes/class"].decode() for record in records)
    assert set(classes.values()) == {3} and len(classes) == 6
    assert {(animals / record["shapes/file"].decode()).is_file() for record in records} == {True}
    views = list(dataset.records("views"))
    assert len(views) == 18
    assert {(animals / view["views/view"].decode()).is_file() for view in views} == {True}
    for described in dataset.metadata.distribution:
        content = (animals / described.content_url).read_bytes()
        assert described.sha256 == hashlib.sha256(content).hexdigest()


def test_a_data_sheet_says_what_it_is_and_how_to_cite_it(animals):
    sheet = (animals / "README.md").read_text(encoding="utf-8")
    for heading in ("Composition", "Splits", "How it was made", "Use", "Licence and citation"):
        assert f"\n## {heading}\n" in sheet
    assert "18 meshes `CLASS/POSE.off`: 6 classes with 3 poses each" in sheet
    assert "data export 'animals-few' --views -o FOLDER`" in sheet
    assert "MIT License" in (animals / "LICENSE.txt").read_text(encoding="utf-8")
    cited = yaml.safe_load((animals / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["type"] == "dataset" and cited["license"] == "MIT"


def test_the_date_is_that_of_the_release():
    (date,) = re.findall(r"^## \[0\.3\.0\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert date == exporting.RELEASED


def test_folds_are_those_of_the_tables():
    from benchmark.datasets.catalogue import open_dataset

    people = open_dataset("people")
    text = exporting._shapes_csv(people, {entry.identifier: entry for entry in people.shapes})
    rows = list(csv.DictReader(text.splitlines()))
    folds = {row["class"]: row["fold"] for row in rows}
    assert list(folds.values()) == [str((p + p // 3) % 3) for p in range(15)]
    scans = open_dataset("humans-scanlike")
    text = exporting._shapes_csv(scans, {entry.identifier: entry for entry in scans.shapes[:2]})
    assert {row["fold"] for row in csv.DictReader(text.splitlines())} == {""}


def test_a_folder_of_the_user_is_not_described(tmp_path):
    source = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    call("data", "export", source, "-o", tmp_path / "out")
    meshes = {"thin", "thick", "dataset.toml"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == meshes
    call("data", "export", source, "--views", "-o", tmp_path / "seen")
    assert {path.name for path in (tmp_path / "seen").iterdir()} == meshes | {"views", "views.csv"}
    assert len(folder_set(tmp_path / "seen").shapes) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("input_", "methods"), [("mesh", ["gps", "shape-dna"]), ("view", ["shape-dna"])]
)
def test_the_folder_scores_as_the_set_does(animals, tmp_path, in_this_process, input_, methods):
    chosen = {"scorer": SMALL_SCORER, "input": input_, "results": tmp_path / "results"}
    scores = []
    for data in ("animals-few", animals):
        jobs = benchmark.run(data, methods, **chosen)
        assert set(jobs["status"]) == {"ok"}, list(jobs["reason"])
        scores.append(jobs[["NN", "FT", "ST", "DCG"]].to_numpy().tolist())
    assert len(scores[0]) == len(methods)
    # Means sum queries in the order of the shapes, which is that of names in a folder.
    assert np.allclose(scores[0], scores[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("folder", "words"),
    [("people", "-d ./people"), ("my set", "-d 'my set'"), ("mine", "-d mine")],
)
def test_the_command_for_an_exported_folder_means_that_folder(monkeypatch, folder, words):
    """'-d people' would be the set of the suite."""
    monkeypatch.setattr(exporting, "export", lambda *_, **__: (("a", "b"), []))
    said = call("data", "export", "animals-few", "-o", folder)
    assert f"wrote 2 files to {folder}; use them with {words}\n" in said

"""``data export``: a generated set that others can download, check, cite and score."""

from __future__ import annotations

import csv
import hashlib
import re
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

import benchmark
from benchmark.commands import export as exporting
from benchmark.commands.export import export
from tests.toy import write_rods
from tests.verbs import call

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def animals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The exported set ``animals-few``."""
    folder = tmp_path_factory.mktemp("export") / "animals"
    call("data", "export", "animals-few", "-o", folder)
    return folder


def files_in(folder: Path) -> dict[str, bytes]:
    every = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in every}


def test_each_export_has_the_same_bytes(animals, tmp_path):
    export("animals-few", tmp_path / "again")
    assert files_in(tmp_path / "again") == files_in(animals)


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
    for described in dataset.metadata.distribution:
        content = (animals / described.content_url).read_bytes()
        assert described.sha256 == hashlib.sha256(content).hexdigest()


def test_a_data_sheet_says_what_it_is_and_how_to_cite_it(animals):
    sheet = (animals / "README.md").read_text(encoding="utf-8")
    for heading in ("Composition", "Splits", "How it was made", "Use", "Licence and citation"):
        assert f"\n## {heading}\n" in sheet
    assert "18 meshes `CLASS/POSE.off`: 6 classes with 3 poses each" in sheet
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
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"thin", "thick", "dataset.toml"}


@pytest.mark.slow
@pytest.mark.parametrize("input_", ["mesh", "view"])
def test_the_folder_scores_as_the_set_does(animals, tmp_path, in_this_process, input_):
    scores = []
    for data in ("animals-few", animals):
        jobs = benchmark.run(data, ["gps", "shape-dna"], input=input_, results=tmp_path / "results")
        assert list(jobs["status"]) == ["ok", "ok"], list(jobs["reason"])
        scores.append(jobs[["NN", "FT", "ST", "DCG"]].to_numpy().tolist())
    # Means sum queries in the order of the shapes, which is that of names in a folder.
    assert np.allclose(scores[0], scores[1], rtol=0, atol=1e-12)

"""``tables --submissions``: rows of others are scored here, marked as such, and named where
something is missing.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from pandas import DataFrame

import benchmark
from benchmark.commands.submissions import REQUIRED, submitted_rows
from benchmark.errors import ConfigurationError
from benchmark.pipeline.record_files import read_files
from tests.toy import write_rods
from tests.verbs import call, refusal

PUBLISHED = Path(__file__).parents[2] / "results" / "records" / "animals.jsonl"

FACTS = {
    "method": '"Far sight"',
    "authors": '["A. Author", "B. Author"]',
    "trained_on": '"nothing"',
    "seen": "[]",
    "compute": '"a minute of one core"',
    "licence": '"CC-BY-4.0"',
    "citation": '"Author and Author, 2026"',
    "code": '"not yet"',
    "data": '"animals"',
    "distances": '"distances.csv"',
}


@pytest.fixture(scope="module")
def published():
    """A published record of the set ``animals``, whose shapes submissions compare."""
    records = read_files([PUBLISHED])
    return next(
        record
        for record in records
        if record.gallery == "animals" and record.input == "mesh" and record.method == "gps"
    )


@pytest.fixture
def submit(tmp_path, monkeypatch, published):
    """Return a function that writes a submission of perfect distances, with some facts changed."""
    monkeypatch.chdir(tmp_path)
    Path("results/records").mkdir(parents=True)
    shutil.copy(PUBLISHED, "results/records")
    labels = np.array(published.labels)
    perfect = (labels[:, None] != labels).astype(float)

    def write(name="mine", matrix=perfect, shapes=tuple(published.shapes), **changes):
        folder = tmp_path / "submissions" / name
        folder.mkdir(parents=True)
        facts = FACTS | changes
        lines = [f"{key} = {value}" for key, value in facts.items() if value]
        (folder / "submission.toml").write_text("\n".join(lines))
        DataFrame(matrix, index=shapes, columns=shapes).to_csv(folder / "distances.csv")
        return folder

    return write


def test_distances_make_a_row_that_says_whose_it_is(submit):
    submit()
    text = call("tables", "-d", "animals", "--input", "mesh", "--submissions", "submissions")
    row = next(line for line in text.splitlines() if line.startswith("|Far sight (submitted)"))
    assert row.count("1.00") == 4
    assert "scored here from distances by A. Author, B. Author; trained on nothing" in text
    assert "licence: CC-BY-4.0" in text
    assert not (Path("results") / "runs").exists()


def test_rows_are_named_by_shape_in_any_order(submit, published):
    matrix = np.abs(np.subtract.outer(np.arange(80.0), np.arange(80.0)))
    submit("first", matrix, method='"First"')
    order = np.random.default_rng(1).permutation(80)
    shuffled = matrix[np.ix_(order, order)]
    submit("second", shuffled, [published.shapes[k] for k in order], method='"Second"')
    first, second = submitted_rows("submissions", "results").records
    assert first.per_query == second.per_query


def test_a_row_that_saw_classes_is_never_bold(submit, published):
    random = np.random.default_rng(3).random((80, 80))
    submit("honest", method='"Honest"')
    submit("random", random + random.T, method='"Random"')
    submit("trained", method='"Trained"', seen='["cat", "dog"]', trained_on='"cats and dogs"')
    text = call("tables", "-d", "animals", "--input", "mesh", "--submissions", "submissions")
    rows = {line.split("|")[1]: line for line in text.splitlines() if "(submitted)|" in line}
    assert "**1.00" in rows["Honest (submitted)"]
    assert "*" not in rows["Trained (submitted)"]
    n_seen = sum(label in ("cat", "dog") for label in published.labels)
    note = rf"Trained on the classes of: Trained \(submitted\) \([^:]+: {n_seen} of 80 shapes\)"
    assert re.search(note, " ".join(text.split()))


@pytest.mark.parametrize("key", REQUIRED)
def test_what_is_missing_is_named_with_what_it_means(submit, key):
    submit(**{key: ""})
    submit("whole", method='"Whole"')
    rows = submitted_rows("submissions", "results")
    assert [record.title for record in rows.records] == ["Whole (submitted)"]
    (note,) = [note for note in rows.notes if note.startswith("no row: submissions/mine")]
    assert f"it does not say {key}; write {key}: {REQUIRED[key]}" in note


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"distances": '"../other.csv"'}, "../other.csv lies outside of it"),
        ({"distances": '"/etc/passwd"'}, "/etc/passwd lies outside of it"),
        ({"distances": '"none.csv"'}, "its distances none.csv are not there"),
        ({"distances": ""}, "neither distances nor forms"),
        ({"forms": '"forms"'}, "it names distances, forms"),
        ({"seen": '["unicorn"]'}, "unicorn"),
        ({"seen": '"cat"'}, "'seen' is not a list of texts"),
        ({"authors": "[1]"}, "'authors' is not a list of texts"),
        ({"method": "3"}, "'method' is not text"),
        ({"data": '"dragons"'}, "'dragons' is no data set with rows here"),
        ({"input": '"touch"'}, "touch"),
        ({"colour": '"red"'}, "colour"),
    ],
)
def test_a_submission_that_cannot_be_scored_is_named(submit, changes, reason):
    submit(**changes)
    (note,) = submitted_rows("submissions", "results").notes
    assert note.startswith("no row: submissions/mine: ")
    assert reason in note


@pytest.mark.parametrize("place", ["submission.toml", "distances.csv", "forms/cat0.off", "more"])
def test_a_link_that_leads_out_of_a_submission_is_refused(submit, tmp_path, place):
    folder = submit()
    link = folder / place
    outside = tmp_path / "outside"
    outside.write_bytes(link.read_bytes() if link.is_file() else b"")
    link.unlink(missing_ok=True)
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(outside)
    (note,) = submitted_rows("submissions", "results").notes
    assert f"the link {place} leads out of it" in note


def write_gltf(folder, buffer):
    """Write a form that names a buffer into a submission."""
    forms = folder / "forms"
    forms.mkdir()
    tree = {"asset": {"version": "2.0"}, "buffers": [{"uri": buffer, "byteLength": 0}]}
    (forms / "cat0.gltf").write_text(json.dumps(tree))


@pytest.mark.parametrize(
    "buffer",
    ["../../../outside.bin", "..%2F..%2F..%2Foutside.bin", "/dev/null"],
)
def test_a_mesh_that_names_a_file_outside_of_a_submission_is_refused(submit, buffer):
    folder = submit()
    write_gltf(folder, buffer)
    (note,) = submitted_rows("submissions", "results").notes
    assert "the mesh forms/cat0.gltf names a file that lies outside of it" in note


def test_a_mesh_may_name_a_file_of_its_submission(submit):
    folder = submit()
    write_gltf(folder, "../buffers/cat0.bin")
    assert not submitted_rows("submissions", "results").refused


@pytest.mark.parametrize("target", ["../mine/circle", "../nowhere", "/dev/zero", ".."])
def test_a_link_without_an_end_is_refused_unless_it_stays_inside(submit, target):
    (submit() / "circle").symlink_to(target)
    (note,) = submitted_rows("submissions", "results").notes
    assert ("the link circle leads out of it" in note) == (target != "../mine/circle")


def test_a_link_within_a_submission_is_followed(submit):
    folder = submit()
    (folder / "real.csv").write_bytes((folder / "distances.csv").read_bytes())
    (folder / "distances.csv").unlink()
    (folder / "distances.csv").symlink_to("real.csv")
    assert not submitted_rows("submissions", "results").refused


def test_other_shapes_and_damaged_distances_are_named(submit, published):
    matrix = np.ones((3, 3)) - np.eye(3)
    submit("few", matrix, published.shapes[:3])
    folder = submit("nan", method='"Nan"')
    text = (folder / "distances.csv").read_text().replace("1.0", "nan", 1)
    (folder / "distances.csv").write_text(text)
    rows = submitted_rows("submissions", "results")
    assert rows.records == ()
    assert all(note.startswith("no row: ") for note in rows.notes)


def test_two_submissions_of_one_name_are_told(submit):
    submit("a")
    submit("b")
    rows = submitted_rows("submissions", "results")
    assert len(rows.records) == 1
    reason = "another submission has its name; choose another 'method'"
    assert rows.notes[-1] == f"no row: submissions/b: {reason}"


def test_a_refused_submission_ends_with_code_1_beside_the_other_rows(submit):
    submit("broken", method='"Broken"', seen='["unicorn"]')
    submit("whole", method='"Whole"')
    words = ("tables", "-d", "animals", "--input", "mesh", "--submissions", "submissions")
    text = call(*words, code=1)
    assert "no row: submissions/broken: " in text
    assert any(line.startswith("|Whole (submitted)|") for line in text.splitlines())
    assert "wrote " in call(*words, "-o", "written", code=1)
    assert "external-whole-submitted" in Path("written/scores.csv").read_text()
    assert benchmark.tables(data="animals", submissions="submissions").refused == (
        "submissions/broken",
    )
    shutil.rmtree("submissions/broken")
    call(*words)


@pytest.fixture
def rods(tmp_path, monkeypatch):
    """Write rods with a row, and a submission of their shapes as forms; return its folder."""
    monkeypatch.chdir(tmp_path)
    write_rods(Path("rods"))
    call("run", "-d", "rods", "--input", "mesh", "-m", "identity", "-j", 0)
    folder = write_rods(Path("submissions/mine/forms"), sides=10).parent
    facts = FACTS | {"data": '"rods"', "distances": "", "forms": '"forms"'}
    lines = [f"{key} = {value}" for key, value in facts.items() if value]
    (folder / "submission.toml").write_text("\n".join(lines))
    return folder


@pytest.mark.slow
def test_forms_make_a_row_of_the_scorer_of_tables(rods):
    """The forms are rods, so each finds its class; they are kept, and are in no other table."""
    words = ("tables", "-d", "rods", "--submissions", "submissions")
    text = call(*words)
    rows = {line.split("|")[1]: line.split("|")[2:] for line in text.splitlines() if "|" in line}
    assert rows["Far sight (submitted)"][0].startswith("1.00 ")
    assert "scored here from a folder of forms by A. Author, B. Author" in text
    n_files = len([*Path("results").rglob("*.npz")])
    again = call(*words)
    table = text[text.index("**Retrieval on rods") :]  # behind the progress
    assert again.endswith(table)
    assert len([*Path("results").rglob("*.npz")]) == n_files
    assert [record.method for record in benchmark.tables(data="rods").records] == ["identity"]


@pytest.mark.slow
def test_forms_of_views_are_scored_on_the_whole_set_alone(submit, monkeypatch):
    """Table III-view also ranks cats and horses by themselves."""
    galleries = []

    def run(planned):
        galleries.extend(job.record.gallery for job in planned.jobs)
        return [replace(job.record, status="failed", reason="stop") for job in planned.jobs]

    monkeypatch.setattr("benchmark.commands.submissions.run_plan", run)
    folder = submit(distances="", forms='"forms"', input='"view"')
    (folder / "forms").mkdir()
    (folder / "forms" / "cat0.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    (note,) = submitted_rows("submissions", "results").notes
    assert "its forms have no scores: stop" in note
    assert galleries == ["animals"]


def test_missing_and_damaged_forms_are_named(rods):
    """A form that is missing or no mesh scores 0, and is named; a folder of others is refused."""
    (rods / "forms" / "thin1.off").unlink()
    (rods / "forms" / "thick2.off").write_text("OFF\n3 1 0\n0 0 0\n")
    text = call("tables", "-d", "rods", "--submissions", "submissions")
    assert "Far sight (submitted): 2 of 6 shapes without a result count 0: thick2: " in text
    assert "; thin1: " in text
    shutil.rmtree(rods / "forms")
    write_rods(rods / "forms", radii={"other": 0.1})
    text = call("tables", "-d", "rods", "--submissions", "submissions", code=1)
    assert "no row: submissions/mine: " in text
    assert "has no form of these shapes; name them like the shapes: thick0.off" in text


def test_a_folder_that_lies_elsewhere_may_be_called_as_in_tables(rods, monkeypatch):
    monkeypatch.chdir(rods)
    (record,) = submitted_rows("..", "../../results").records
    assert (record.gallery, record.scores["NN"]) == ("rods", 1.0)


def test_a_folder_without_submissions_is_refused(tmp_path):
    assert "has a submission.toml; see docs/how-to/submit.md" in refusal(
        "tables", "--submissions", tmp_path
    )
    with pytest.raises(ConfigurationError):
        benchmark.tables(submissions=tmp_path)

"""Results of other programs as rows: shapes are paired by name."""

import json
import pickle
import shutil

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace

from benchmark.commands.external_rows import forms_of, keep_distances, method_name
from benchmark.commands.score import score
from benchmark.errors import ConfigurationError
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records, write_record
from benchmark.report.record_facts import seconds_of
from retrieval.measures import score_draws
from tests.report.records import record as made_up_record
from tests.scoring.line import LABELS, NAMES, D
from tests.toy import SMALL_SCORER, rod, write_off, write_rods
from tests.verbs import call, refusal

#: Runs start no processes: each would import torch anew.
pytestmark = pytest.mark.usefixtures("in_this_process")

NAMED = dict(zip(NAMES, LABELS, strict=True))


@pytest.fixture
def beside(tmp_path):
    """A results folder with a row of the same shapes."""
    scores = score_draws([D], LABELS)
    write_record(
        tmp_path,
        made_up_record(
            "gps", dataset="line", gallery_digest="d", shapes=NAMES, labels=LABELS, **scores
        ),
    )
    return tmp_path


def test_a_row_stands_beside_the_others_in_their_order_of_shapes(beside):
    turned = pd.DataFrame(D, NAMES, NAMES).iloc[::-1, ::-1]
    record = keep_distances(beside, score(turned, NAMED), "Their method", "line", "mesh")
    assert (record.method, record.gallery, record.gallery_digest) == (
        "external-their-method",
        "line",
        "d",
    )
    assert record.shapes == NAMES
    assert record.per_query == score_draws([D], LABELS)["per_query"]
    np.testing.assert_allclose(read_distances(beside, record), D)
    assert {other.method for other in read_records(beside)} == {"gps", "external-their-method"}


@pytest.mark.parametrize(
    ("labels", "dataset", "problem"),
    [
        (
            {f"x{name}": label for name, label in NAMED.items()},
            "line",
            "not those of 'line': the first .* is 'xa0'",
        ),
        (
            dict(zip(NAMES, [*LABELS[1:], "a"], strict=True)),
            "line",
            "the first that differs is 'a9'",
        ),
        (NAMED, "tosca", "no row of 'tosca', mesh, is here"),
        (NAMED, "/no/folder", "'/no/folder' is neither a data set nor a folder"),
    ],
)
def test_what_cannot_stand_beside_is_named(labels, dataset, problem, beside):
    with pytest.raises(ConfigurationError, match=problem):
        keep_distances(beside, score(D, labels), "Theirs", dataset, "mesh")


def test_a_folder_stands_for_the_data_set_at_its_path(beside, tmp_path):
    (tmp_path / "line").mkdir()
    with pytest.raises(ConfigurationError, match="no row of '.*line', mesh, is here"):
        keep_distances(beside, score(D, NAMED), "Theirs", str(tmp_path / "line"), "mesh")
    for record in read_records(beside):
        write_record(
            beside, replace(record, data=replace(record.data, path=str(tmp_path / "line")))
        )
    record = keep_distances(beside, score(D, NAMED), "Theirs", str(tmp_path / "line"), "mesh")
    assert (record.gallery, record.data.path) == ("line", str(tmp_path / "line"))


def test_a_row_replaces_its_earlier_one_but_none_of_another_title(beside):
    for factor in (1.0, 2.0):
        keep_distances(beside, score(factor * D**factor, NAMED), "Theirs", "mine", "mesh")
    assert [record.title for record in read_records(beside)].count("Theirs") == 1
    with pytest.raises(
        ConfigurationError, match="'Theirs' and 'Theirs!' have one name, external-theirs"
    ):
        keep_distances(beside, score(D, NAMED), "Theirs!", "mine", "mesh")


def test_the_name_of_a_row_is_that_of_the_page():
    assert method_name("My method") == "external-my-method"
    with pytest.raises(ConfigurationError, match="cannot be the title of a row"):
        method_name("論文")


def test_forms_are_a_row_that_is_scored_once(tmp_path):
    """One form is missing, one is damaged, and one has other vertices."""
    rods, results = write_rods(tmp_path / "rods"), tmp_path / "results"
    made = shutil.copytree(rods, tmp_path / "made")
    write_off(made / "thin1.off", rod(0.06, 1.2, rings=12, sides=6))
    (made / "thin0.off").unlink()
    (made / "thick2.off").write_text("OFF\n1 0 0\n0 0 0\n")
    words = (
        "-d",
        rods,
        "--input",
        "mesh",
        "--scorer",
        SMALL_SCORER,
        "--results",
        results,
        "--forms",
    )
    assert pickle.dumps(forms_of(made, "Mine"))  # a worker gets them
    assert "Mine" in call("run", *words, f"Mine={made}", "-j", 0)
    (record,) = read_records(results)
    assert (record.method, record.family, record.coverage) == (
        "external-mine",
        "external",
        pytest.approx(4 / 6),
    )
    assert {name for name, _ in record.unsupported} == {"thin0", "thick2"}
    assert record.per_query["NN"][record.shapes.index("thin0")] == 0
    assert seconds_of(record) is None
    assert "0 of 1 jobs to run" in call("run", *words, f"Mine={made}", "-j", 0)
    assert "'Mine' and 'Mine!' have one name, external-mine" in refusal(
        "run", *words, f"Mine!={made}"
    )
    write_off(made / "thick2.off", (far := rod(0.2, 1.2)).with_vertices(far.vertices + 1e8))
    assert "1 of 1 jobs to run" in call("run", *words, f"Mine={made}", "-j", 0)
    assert {name for name, _ in read_records(results)[0].unsupported} == {"thin0"}
    assert "name them like the shapes: thick0.off" in refusal("run", *words, f"Mine={results}")
    assert "nowhere is not a folder" in refusal("run", *words, f"Mine={tmp_path / 'nowhere'}")
    assert "two methods are called 'external-a'" in refusal(
        "run", *words, f"A={made}", "--forms", f"a={made}"
    )
    assert "pass -d FOLDER --forms NAME=DIR, without -m" in refusal(
        "run", *words, f"A={made}", "-m", "gps"
    )


@pytest.mark.parametrize(
    ("shape", "file"),
    [
        ("cat1", "cat1.OFF"),
        ("cat1", "cat1.Obj"),
        ("cat1", "cat1.ply.gz"),
        ("cat.v2", "cat.v2.stl"),
        ("caf\u00e9/1", "cafe\u0301/1.off"),
        (r"cat\n1", "cat\n1.off"),
        ("cat1", "cat1.3mf"),
    ],
)
def test_a_form_has_each_name_that_the_file_of_a_shape_may_have(tmp_path, shape, file):
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text("")
    forms = forms_of(tmp_path, "Mine").create()
    assert forms.file_of(shape) == tmp_path / file
    assert forms.file_of("dog1") is None


def test_of_two_files_of_a_form_that_of_the_preferred_format_is_read(tmp_path):
    for file in ("cat1.obj", "cat1.off", "cat1.ply"):
        (tmp_path / file).write_text("")
    assert forms_of(tmp_path, "Mine").create().file_of("cat1") == tmp_path / "cat1.off"


def test_where_a_row_goes_is_checked_before_anything_is_computed_or_printed(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.cli.scores.say_lines", None)
    command = (
        "score",
        tmp_path / "d.txt",
        "--labels",
        tmp_path / "labels.txt",
        "--results",
        tmp_path,
        "--dataset",
    )
    assert "no row of 'tosca', mesh, is here" in refusal(
        *command, "tosca"
    )  # before files are read, which are none
    np.savetxt(tmp_path / "d.txt", D)
    (tmp_path / "labels.txt").write_text("\n".join(LABELS))
    assert "paired by the names of shapes, and these distances have none" in refusal(
        *command, "mine"
    )


def test_verbs_show_rows_of_other_programs_beside_ours(tmp_path):
    rods, results = write_rods(tmp_path / "rods", bends=(0.0, 1.0)), tmp_path / "results"
    (tmp_path / "d.csv").write_text(
        pd.DataFrame(1 - np.eye(4), *[["thin1", "thin0", "thick0", "thick1"]] * 2).to_csv()
    )
    selected = ("-d", rods, "--input", "mesh", "--scorer", SMALL_SCORER, "--results", results)
    call("run", *selected, "-m", "identity", "-j", 0)
    kept = call(
        "score", tmp_path / "d.csv", "--labels", rods, "--results", results, "--title", "My method"
    )
    assert "kept as external-my-method" in kept
    call("run", *selected, "--forms", f"Other={rods}", "-j", 0)
    rows = {row["method"]: row for row in json.loads(call("tables", *selected, "--format", "json"))}
    assert {"identity", "external-my-method", "external-other"} <= rows.keys()
    assert rows["external-my-method"]["NN"] == pytest.approx(1 / 3, abs=1e-6)
    assert rows["external-other"]["NN"] == rows["identity"]["NN"]
    assert "external-my-method" in call("compare", "external-my-method", "identity", *selected)

"""What the verbs print, Python gets as data, with the same refusals."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import benchmark
from benchmark.api import CanonicalForm, MethodInfo
from benchmark.commands.forget import forget
from benchmark.commands.forms import form_with_notes
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.pipeline.records import write_record
from tests.report.records import failed, record
from tests.toy import rod, write_rods
from tests.verbs import call, refusal


@pytest.fixture
def results(tmp_path):
    """A folder with records of two methods, one that fails, and one of another seed."""
    folder = tmp_path / "results"
    folder.mkdir()
    others = [failed("bad"), record("gps", seed=3)]
    for each in [record("gps", 0.75), record("skeleton", 0.5), *others]:
        write_record(folder, each)
    return folder


def test_tables_are_those_that_the_verb_prints_and_their_notes_are_its_messages(results):
    tables = benchmark.tables(results=results)
    said = call("tables", "--results", results)
    assert tables.markdown() in said
    assert len(tables.notes) == 2
    assert all(note in said.replace("\n", " ") for note in tables.notes)
    assert tables.latex() in call("tables", "--results", results, "--format", "latex")
    printed = call("tables", "--results", results, "--format", "json")
    rows = json.loads(printed[printed.index("[\n") :])
    assert tables.rows["method"].tolist() == [row["method"] for row in rows]
    assert tables._repr_markdown_() == tables.markdown()


def test_tables_are_written_as_the_verb_writes_them(results, tmp_path):
    names = benchmark.tables(results=results).write(tmp_path / "here")
    call("tables", "--results", results, "-o", tmp_path / "there")
    for name in names:
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


def test_differences_are_those_that_the_verb_prints(results):
    found = benchmark.compare("gps", "skeleton", results=results)
    printed = call("compare", "gps", "skeleton", "--results", results, "--format", "csv")
    assert found.to_csv(index=False, float_format="%.6f").strip() in printed
    assert any("another scorer or seed" in note for note in found.attrs["notes"])


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda r: benchmark.tables("V", results=r), ("tables", "-t", "V")),
        (lambda r: benchmark.tables(results=r, seed=9), ("tables", "--seed", 9)),
        (lambda r: benchmark.compare("gps", "none", results=r), ("compare", "gps", "none")),
        (lambda r: benchmark.plan("no-such-set", results=r), ("plan", "-d", "no-such-set")),
        (lambda r: benchmark.plan(methods="gpz", results=r), ("plan", "-m", "gpz")),
        (lambda r: benchmark.merge(r / "nothing", r), ("merge", None)),
        (lambda r: forget("gpz", results=r), ("forget", "-m", "gpz")),
        (lambda r: forget(results=r), ("forget",)),
    ],
)
def test_python_refuses_with_the_words_of_the_verb(results, function, words):
    words = [results / "nothing" if word is None else word for word in words]
    with pytest.raises(BenchmarkError) as refused:
        function(results)
    assert str(refused.value) == refusal(*words, "--results", results)


def test_a_plan_has_the_jobs_and_the_reasons_that_the_verb_prints(tmp_path):
    rods = write_rods(tmp_path / "rods")
    plan = benchmark.plan(rods, ["identity", "gps"], input="mesh", results=tmp_path / "results")
    assert plan.frame["runs"].tolist() == [True, True]
    words = ("-m", "identity", "-m", "gps", "--input", "mesh", "--results", tmp_path / "results")
    said = call("plan", "-d", rods, *words)
    assert "2 of 2 jobs to run" in said
    assert all(state in said and job in said for job, state in plan.frame["state"].items())
    assert "<table" in plan._repr_html_()


def test_records_of_a_colleague_are_added(results, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    merged = benchmark.merge(results, mine)
    assert len(merged.added) == 4
    assert benchmark.merge([results, mine], mine).known == 4
    with pytest.raises(ConfigurationError, match="--record names a conflict to resolve"):
        benchmark.merge(results, mine, records=["gps"])


def test_forget_names_what_goes_and_deletes_it_with_yes(results):
    named = forget("gps", results=results)
    assert len(named.records) == 2
    assert all(path.is_file() for path in named.files)
    assert str(forget("gps", results=results, yes=True)) == str(named)
    assert not any(path.is_file() for path in named.files)


class Counting:
    """A method that counts how often it is asked."""

    info = MethodInfo(name="counting", title="Counting", family="extended")

    def __init__(self):
        self.asked = 0

    def canonicalise(self, shape):
        self.asked += 1
        return CanonicalForm(shape.mesh.vertices, shape.mesh.faces, {"outline_blur": 1.5})


def test_a_form_has_the_notes_of_its_method_which_is_asked_once():
    method, mesh = Counting(), rod(0.1, 0.5)
    shape = SimpleNamespace(mesh=mesh, identifier="rod")
    form = form_with_notes(method, shape, {"joined_pieces": 2.0})
    assert method.asked == 1
    assert form.notes == {"joined_pieces": 2.0, "outline_blur": 1.5}
    np.testing.assert_array_equal(form.vertices, mesh.vertices)


def test_a_learner_that_measures_its_fit_apart_is_asked_and_told_what_to_do_instead():
    method, mesh = Counting(), rod(0.1, 0.5)
    method.measure_fit = lambda shape: {"doubt": "it may not fit"}
    with pytest.warns(DeprecationWarning, match="return its notes with the form"):
        form = form_with_notes(method, SimpleNamespace(mesh=mesh, identifier="rod"), {})
    assert form.notes["doubt"] == "it may not fit"

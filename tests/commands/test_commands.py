"""What the verbs print, Python gets as data, with the same refusals."""

import csv
import inspect
import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import benchmark
from benchmark.api import CanonicalForm, MethodInfo
from benchmark.cli.options import Selection
from benchmark.cli.run import _print_tables
from benchmark.commands.external_rows import record_beside, score_and_keep
from benchmark.commands.forget import Forgotten, forget
from benchmark.commands.forms import form_with_notes
from benchmark.commands.models import fetch_models
from benchmark.commands.plan import Plan
from benchmark.commands.printable_tables import Tables
from benchmark.commands.report import draw_tables, write_pages
from benchmark.commands.run import tables_of_run
from benchmark.commands.selection import as_list
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.pipeline.record_files import write_record
from benchmark.protocols.tables import ROBUST, own_table
from benchmark.report.pages import _command
from benchmark.report.tables import table_views
from tests.report.records import LABELS, failed, record
from tests.runs.toy import LIGHT
from tests.toy import SMALL_SCORER, rod, write_rods
from tests.verbs import call, refusal

#: Runs start no processes: each would import torch anew.
pytestmark = pytest.mark.usefixtures("in_this_process")


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


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda r: benchmark.plan("ellipsoids", "gps", input="Mesh", results=r), "input 'Mesh'"),
        (lambda r: benchmark.plan("ellipsoids", "gps", seed="a", results=r), "seed='a'"),
        (lambda r: benchmark.plan("ellipsoids", "gps", seed=1.5, results=r), "seed=1.5"),
        (lambda r: benchmark.plan("ellipsoids", "gps", seed=True, results=r), "seed=True"),
        (lambda r: benchmark.plan("ellipsoids", "gps", seed=-1, results=r), "seed=-1"),
        (lambda r: benchmark.plan("ellipsoids", "gps", seed=2**63, results=r), f"to {2**63 - 1}"),
        (lambda r: benchmark.plan("ellipsoids", "gps", rerun=["fail"], results=r), "'fail'"),
        (lambda r: benchmark.plan("ellipsoids", "gps", subjects=[], results=r), "no subject"),
        (lambda r: benchmark.plan("ellipsoids", "gps", subjects=",", results=r), "no subject"),
        (lambda r: benchmark.tables(seed="a", results=r), "seed='a'"),
        (lambda r: benchmark.tables(input="Mesh", results=r), "input 'Mesh'"),
        (lambda r: benchmark.compare("gps", "identity", seed="a", results=r), "seed='a'"),
        (lambda r: benchmark.compare("gps", "identity", input="x", results=r), "input 'x'"),
        (lambda r: benchmark.canonicalise("a.off", method="gps", seed="a"), "seed='a'"),
        (lambda r: benchmark.canonicalise("a.off", method="gps", seed=-1), "seed=-1"),
        (lambda r: benchmark.retrieve("a.off", "ellipsoids", "gps", input="x", results=r), "'x'"),
        (lambda r: benchmark.retrieve("a.off", "ellipsoids", "gps", count=0, results=r), "count=0"),
        (lambda r: benchmark.merge(r, r / "others", take="mine"), "'mine'"),
        (lambda r: benchmark.plan("ellipsoids", plugins="none.py", results=r), "none.py"),
        (lambda r: benchmark.plan("ellipsoids", "gps", rerun="fail", results=r), "'fail'"),
        (lambda r: benchmark.forget(records="gps", results=r), "no record 'gps'"),
        (lambda r: benchmark.merge(r, r / "others", take="ours", records="gps"), "'gps'"),
        (lambda r: benchmark.merge(iter([r / "others"]), r / "mine"), "others holds no records"),
        (lambda r: benchmark.demo("none.off", r / "a.html", methods="identity"), "none.off"),
        (lambda r: benchmark.demo(methods="skeletons", output=r / "a.html"), "'skeletons'"),
        (lambda r: benchmark.listing("method", results=r), "unknown list 'method'"),
        (lambda r: benchmark.describe("gps", plugins="none.py"), "none.py"),
    ],
)
def test_arguments_of_python_that_no_verb_can_pass_are_refused_by_name(results, function, message):
    with pytest.raises(BenchmarkError, match=re.escape(message)):
        function(results)


def test_whole_numbers_of_numpy_are_seeds(tmp_path):
    rods = write_rods(tmp_path / "rods")
    jobs = benchmark.plan(rods, "identity", seed=np.int64(3), input="mesh", results=tmp_path).jobs
    assert [job.record.seed for job in jobs] == [3]


def test_no_method_of_the_suite_depends_on_the_seed_as_the_page_says():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "methods.md").read_text()
    assert "`--seed` changes no form and no descriptor of these methods" in page
    for name in re.findall(r"^\| `([\w-]+)`", page, re.MULTILINE):
        assert benchmark.describe(name)["random"] == "nothing: --seed does not change the form"


def test_a_single_plugin_is_a_list_of_one():
    plugin = Path(__file__).parents[2] / "examples" / "ray_stretch.py"
    assert benchmark.describe("ray-stretch", plugins=str(plugin)) == benchmark.describe(
        "ray-stretch", plugins=[plugin]
    )


def test_each_argument_for_several_texts_takes_a_single_one_and_any_iterable():
    functions = [*(getattr(benchmark, name) for name in dir(benchmark)), draw_tables, fetch_models]
    several = []
    for function in functions:
        for name, argument in inspect.signature(function).parameters.items():
            if re.search(r"\w\[str( \| Path)?\]", argument.annotation):
                several.append(f"{function.__name__}({name})")
                assert re.fullmatch(
                    r"(str \| Iterable\[str\]|str \| Path \| Iterable\[str \| Path\])( \| None)?",
                    argument.annotation,
                ), several[-1]
    assert len(several) > 20


@pytest.mark.parametrize(
    ("several", "values"),
    [
        ("gps", ["gps"]),
        (Path("a"), [Path("a")]),
        (("b", "a"), ["b", "a"]),
        ({"b", "a"}, ["a", "b"]),
        (iter("ba"), ["b", "a"]),
        ({"b": 1, "a": 2}.keys(), ["a", "b"]),
        (np.array(["b", "a"]), ["b", "a"]),
        (pd.Series(["b", "a"]), ["b", "a"]),
        (min, [min]),
        ((), []),
    ],
)
def test_values_are_several_if_they_can_be_iterated_over_and_are_no_text(several, values):
    assert as_list(several) == values


def test_methods_and_data_are_read_once_from_what_holds_them_once(results, tmp_path):
    rods = write_rods(tmp_path / "rods")
    methods = ["identity", "gps"]
    of_list = benchmark.plan([rods], methods, input="mesh", results=tmp_path)
    for kind in (iter, set, np.array):
        planned = benchmark.plan(iter([rods]), kind(methods), input="mesh", results=tmp_path)
        assert {job.record.key for job in planned.jobs} == {job.record.key for job in of_list.jobs}
    shown = benchmark.tables(methods=iter(["gps"]), results=results)
    assert str(shown) == str(benchmark.tables(methods=["gps"], results=results))
    named = benchmark.forget(iter(["gps"]), iter(["rods"]), results=results)
    assert len(named.records) == 2


def test_a_subject_and_a_plugin_that_are_named_twice_are_one(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    plugin = tmp_path / "own.py"
    plugin.write_text(
        "from benchmark.api import canonical_form\n"
        '@canonical_form(name="own", title="Own")\n'
        "def own(shape): return shape.mesh.vertices\n"
    )
    (tmp_path / "link.py").symlink_to(plugin)
    keys = set()
    for subjects, plugins in (("thin,thick", plugin), ("thin,thin,thick", [plugin] * 2)):
        planned = benchmark.plan(
            rods, "own", subjects=subjects, plugins=plugins, input="mesh", results=tmp_path
        )
        keys |= {job.record.key for job in planned.jobs}
    assert len(keys) == 1
    twice = benchmark.plan(
        rods, "own", plugins=[plugin, tmp_path / "link.py"], input="mesh", results=tmp_path
    )
    assert len(twice.jobs) == 1


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


@pytest.mark.parametrize("selected", [{"unused": True}, {"methods": "gps"}])
def test_forget_makes_no_results_folder(tmp_path, selected):
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(ConfigurationError, match=f"{folder.name} holds no results of runs"):
            forget(results=folder, yes=True, **selected)
    assert not [*tmp_path.iterdir()]


def test_a_form_has_the_notes_of_its_method_which_is_asked_once():
    method, mesh = Counting(), rod(0.1, 0.5)
    shape = SimpleNamespace(mesh=mesh, identifier="rod")
    form = form_with_notes(method, shape, {"joined_pieces": 2.0})
    assert method.asked == 1
    assert form.notes == {"joined_pieces": 2.0, "outline_blur": 1.5}
    np.testing.assert_array_equal(form.vertices, mesh.vertices)
    assert form.body is mesh  # whose places colour the form when it is drawn


def test_a_form_of_other_triangles_has_no_body_that_could_colour_it():
    method, mesh = Counting(), rod(0.1, 0.5)
    method.canonicalise = lambda shape: CanonicalForm(shape.mesh.vertices, shape.mesh.faces[::-1])
    form = form_with_notes(method, SimpleNamespace(mesh=mesh, identifier="rod"), {})
    assert form.body is None


def test_a_learner_that_measures_its_fit_apart_is_asked_and_told_what_to_do_instead():
    method, mesh = Counting(), rod(0.1, 0.5)
    method.measure_fit = lambda shape: {"doubt": "it may not fit"}
    with pytest.warns(DeprecationWarning, match="return its notes with the form"):
        form = form_with_notes(method, SimpleNamespace(mesh=mesh, identifier="rod"), {})
    assert form.notes["doubt"] == "it may not fit"


@pytest.fixture
def folders(tmp_path):
    """A folder that can be used, one of a single class, and one with an unknown key in settings."""
    write_rods(tmp_path / "good", bends=(0.0, 1.0))
    write_rods(tmp_path / "one class", radii={"thin": 0.05})
    write_rods(tmp_path / "settings")
    (tmp_path / "settings" / "dataset.toml").write_text("unknown = 1")
    return tmp_path


def selected(folders, *names):
    data = [word for name in names for word in ("-d", folders / name)]
    return (*data, "-m", "surface-area", "--input", "mesh", "--results", folders / "results")


def test_a_data_set_that_is_refused_ends_the_run_of_no_other_and_the_exit_code_says_so(folders):
    words = selected(folders, "settings", "good", "one class")
    for verb in (["run", "-j", 0], ["plan"]):
        said = call(*verb, *words, code=1).replace("\n", " ")
        assert f"refused: {folders / 'one class'}: " in said
        assert f"refused: {folders / 'settings'}: " in said
        assert "unknown" in said
        assert "of 1 jobs to run" in said
    assert "Retrieval on good" in call("tables", "--results", folders / "results")


def test_data_sets_of_which_none_can_be_used_are_an_error(folders):
    assert "class" in refusal("run", *selected(folders, "one class", "settings"), "-j", 0)
    assert "class" in refusal("plan", *selected(folders, "one class"))


def test_a_name_that_is_no_data_set_or_no_method(folders):
    said = call("run", "-j", 0, *selected(folders, "good", "nowhere"), code=1)
    assert "nowhere: " in said.replace("\n", " ")
    assert "unknown method 'nothing'" in refusal(
        "run", "-j", 0, *selected(folders, "good", "settings"), "-m", "nothing"
    )


def test_python_warns_of_a_data_set_that_is_refused(folders):
    data = [folders / "one class", folders / "good"]
    with pytest.warns(UserWarning, match="one class is refused: "):
        jobs = benchmark.run(data, "surface-area", results=folders / "results")
    assert jobs.status.tolist() == ["ok"]


def test_a_quick_run_of_few_poses_prints_the_table_that_tables_prints(folders):
    words = ("-d", folders / "good", "--results", folders / "results", "--quick")
    said = call("run", "-j", 0, *words, "-m", "surface-area", "--input", "mesh")
    table = call("tables", *words)
    assert "quick run with at most 3 poses of each class" in table.replace("\n", " ")
    assert table in said


def test_a_run_prints_its_table_however_its_scorer_is_written(folders):
    written = "cm-bof[subdivisions=0,image_size=64]"
    words = ("-d", folders / "good", "--results", folders / "results")
    said = call("run", *words, "-m", "identity", "--input", "mesh", "--scorer", written, "-j", 0)
    assert "Retrieval on good" in said
    proposed = said.partition("python -m benchmark ")[2]
    assert SMALL_SCORER in proposed
    assert call("tables", *words, "--scorer", SMALL_SCORER) in said


def test_a_named_method_without_a_job_is_named_beside_the_table():
    said = call("tables", "-t", "III", "-m", "gps", "-m", "gsp", "-m", "identity", "--published")
    assert "no finished job of gsp: run it, or see 'list methods' for its name" in said
    assert "no finished job" not in call("tables", "-t", "III", "-m", "gps", "--published")


def test_a_run_of_a_set_by_its_short_name_prints_the_tables_of_that_set(tmp_path):
    """'people' is the first draw, which has a table of its own in plans, and Table I in records."""
    done = record("gps", 0.6, dataset="people[draw=0]", stand_in_for="shrec14-synthetic")
    job = SimpleNamespace(record=done, galleries=[SimpleNamespace(table=own_table("people"))])
    planned = Plan(tmp_path, (job,), (done,))
    tables = tables_of_run(planned, [done])
    assert [view.table.identifier for view in tables.views] == ["I"]
    assert "|GPS|" in tables.markdown()


def test_only_tables_with_a_row_of_a_named_method_are_printed(results):
    write_record(results, record("shape-dna", dataset="balls", scorer=""))
    for format_ in ("markdown", "latex"):
        said = call("tables", "-m", "shape-dna", "--results", results, "--format", format_)
        assert "balls" in said
        assert "rods" not in said
    says = refusal("tables", "-m", "sheep", "--results", results, "--format", "latex")
    assert "no table has a row of sheep;" in says
    assert "no finished job of sheep: run it" in says


def test_a_comparison_with_all_rows_names_no_method_that_is_missing(results):
    assert "no finished job of" not in call("compare", "gps", "--results", results)
    assert benchmark.compare("gps", results=results).attrs["notes"] == [
        "not shown: 1 job of another scorer or seed: pass --scorer cm-bof --seed 3"
    ]


def test_what_is_forgotten_counts_records_and_no_other_json():
    names = ["records/a.json", "records/a.npz", "code.json", "forms/b.npz", "forms/c.npz"]
    files = tuple(Path("results/runs") / name for name in names)
    assert str(Forgotten((), files, 2_500_000)) == "1 record, 2 forms, 2.5 MB"


def test_scores_as_csv_are_those_of_the_tables_and_methods_that_are_named():
    def scored(*words):
        said = call("tables", "--published", "--format", "csv", *words)
        lines = csv.DictReader(said[said.index("table,dataset") :].splitlines())
        return {(line["table"], line["dataset"], line["method"]) for line in lines}

    assert scored("-t", "II", "-m", "gps") == {
        ("II", "humans-scanlike", "gps"),
        ("II-view", "humans-scanlike", "gps"),
    }
    of_robustness = scored("-t", "robustness")
    assert {method for _, _, method in of_robustness} == {*ROBUST}
    assert all(dataset.startswith("animals-few") for _, dataset, _ in of_robustness)
    found = benchmark.tables("II", methods="gps", published=True).scores
    assert {*found.method} == {"gps"}
    assert {*found.table} == {"II", "II-view"}


def test_the_table_of_robustness_has_the_named_methods_alone():
    named = benchmark.tables("robustness", methods="gps", published=True)
    heading = next(line for line in named.markdown().splitlines() if line.startswith("|Change"))
    assert heading.count("|") == 4  # change, strength and one method
    assert {*named.scores.method} == {"gps"}
    refused = refusal("tables", "--published", "-t", "robustness", "-m", "skeleton")
    assert refused.startswith("no finished job of skeleton under results belongs to table robustn")


def test_a_named_table_without_a_job_is_named_beside_the_others():
    notes = benchmark.tables(["II", "shrec15"], published=True).notes
    assert "not shown: table shrec15, of which no finished job fits the selection" in notes
    assert not benchmark.tables(["II", "robustness", "extended"], published=True).notes


def test_a_method_is_not_compared_with_itself():
    refused = refusal("compare", "gps", "gps", "--published")
    assert refused.startswith("gps cannot be compared with itself")


def test_formats_in_which_there_is_no_table_of_robustness_are_refused(tmp_path):
    words = ("tables", "-t", "robustness", "--published", "--format")
    for format in ("latex", "json"):
        for more in ((), ("-o", tmp_path / "out")):
            refused = refusal(*words, format, *more)
            assert refused.startswith(f"the table of robustness is not in {format}")
    assert not (tmp_path / "out").exists()
    files = benchmark.tables("robustness", published=True).write(tmp_path / "every")
    assert sorted(files) == ["robustness.md", "scores.csv"]


def test_queries_and_their_gallery_may_be_folders_of_one_name(tmp_path):
    """Each class has one query, so that the folder could not rank itself."""
    queries = write_rods(tmp_path / "a" / "rods", bends=(0.0,))
    gallery = write_rods(tmp_path / "b" / "rods", bends=(0.5, 1.0))
    stored = ("--results", tmp_path / "results", "--scorer", "light")
    words = ("-d", queries, "--gallery", gallery, "--input", "mesh", "-m", "identity", *LIGHT)
    call("run", *words, *stored[:2])
    assert "0 of 1 jobs to run" in call("plan", *words, *stored[:2])
    call("report", *stored, "-o", tmp_path / "report")
    (page,) = (tmp_path / "report").glob("*-queries.html")
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', page.read_text())
    pictures = [{name: picture for name, _, picture in side} for side in json.loads(data)["sides"]]
    assert pictures[0]["thin0"] != pictures[1]["thin0"]
    command = _command(benchmark.tables(results=stored[1], scorer="light").views[0], stored[1])
    assert f"--gallery {gallery}" in command


def test_a_list_of_no_models_has_its_heading_alone(monkeypatch):
    monkeypatch.setattr("benchmark.cli.names.listing", lambda *_, **__: [])
    assert call("list", "models").split() == ["training", "model", "origin", "schedule"]


def test_a_folder_with_rows_of_another_input_or_of_quick_runs_alone_gets_no_second_table(folders):
    """Beside none of them a row of another program may stand."""
    stored = folders / "results"
    words = ("-d", folders / "good", "--results", stored, "-m", "surface-area", "-j", 0)
    call("run", *words, "--input", "mesh", "--quick")
    with pytest.raises(ConfigurationError, match="no row of 'good', mesh, is here"):
        record_beside(stored, "good", "mesh", "mine")
    call("run", *words, "--input", "mesh")
    assert record_beside(stored, "good", "mesh", "mine").gallery == "good"
    with pytest.raises(ConfigurationError, match="no row of 'good', view, is here"):
        record_beside(stored, "good", "view", "mine")


def test_the_command_that_forgets_a_folder_that_is_gone_names_the_results(folders):
    stored = folders / "results"
    words = ("--results", stored, "-m", "surface-area", "--input", "mesh")
    call("run", "-d", folders / "good", *words, "-j", 0)
    (folders / "moved").mkdir()
    (folders / "good").rename(folders / "moved" / "good")
    said = call("run", "-d", folders / "moved" / "good", *words, "-j", 0)
    assert f"'forget -d {folders / 'good'} --results {stored}'" in said


def test_robustness_has_no_pages(tmp_path):
    with pytest.raises(ConfigurationError, match="the table of robustness has no pages"):
        write_pages(Tables((), ()), tmp_path / "report")
    assert not (tmp_path / "report").exists()


def test_two_folders_of_forms_with_one_title_are_refused():
    said = refusal("run", "-d", "rods", "--forms", "A=x", "--forms", "A=y")
    assert "two folders one title; give each NAME=DIR another NAME" in said


@pytest.mark.parametrize(
    ("folder", "name"), [("scans.v2", "scans.v2"), ("tosca", "tosca-folder"), ("a.cla", "a")]
)
def test_distances_stand_beside_the_rows_of_the_folder_of_their_labels(
    tmp_path, monkeypatch, folder, name
):
    """Its name may have a dot, or be that of a set of the suite."""

    def beside(results, dataset, input_, title):
        raise ConfigurationError(f"beside {dataset}")

    monkeypatch.setattr("benchmark.commands.external_rows.record_beside", beside)
    labels = tmp_path / folder
    labels.touch() if folder.endswith(".cla") else labels.mkdir()
    with pytest.raises(ConfigurationError, match=f"beside {name}$"):
        score_and_keep(tmp_path / "D.csv", labels, results=tmp_path)


def test_a_row_is_printed_by_the_name_of_one_of_its_trainings(results):
    write_record(results, record("net[training_seed=1]", 0.5))
    write_record(results, record("net", 0.25))
    said = call("tables", "-m", "net[training_seed=1]", "--results", results)
    assert "|.38 .50 .60 .70|" in said


def test_the_short_name_of_the_first_draw_finds_its_records(tmp_path):
    for name in ("people[draw=0]", "people[draw=0][noise=1]", "people[draw=1]"):
        write_record(tmp_path, record("gps", dataset=name, stand_in_for="shrec14-synthetic"))
    for short, full in (
        ("people", "people[draw=0]"),
        ("people[noise=1]", "people[draw=0][noise=1]"),
        ("people[draw=1]", "people[draw=1]"),
    ):
        shown = benchmark.tables(results=tmp_path, data=short)
        assert {each.data.name for each in shown.records} == {full}
        assert [each.data.name for each in forget(data=short, results=tmp_path).records] == [full]
    assert record_beside(tmp_path, "people", "mesh", "mine").data.name == "people[draw=0]"


def test_a_table_has_the_name_of_a_data_set_only_if_no_other_table_shows_it(results):
    write_record(results, record("gps", dataset="tosca"))
    says = refusal("tables", "-t", "tosca", "--results", results).replace("\n", " ")
    assert "unknown table 'tosca'" in says
    assert "Retrieval on rods" in call("tables", "-t", "rods", "--results", results)


def test_a_run_proposes_a_report_of_all_draws_that_it_ran_and_none_of_robustness(
    tmp_path, monkeypatch, capsys
):
    names = ("people[draw=0]", "people[draw=1]")
    done = [record("gps", dataset=name, stand_in_for="shrec14-synthetic") for name in names]
    noisy = record("gps", dataset="animals-few[noise=2]")
    for rows, chosen, proposed in (
        (done, names[:1], "report -d 'people[draw=0]' -d 'people[draw=1]' --results"),
        ([noisy], (), ""),
    ):
        tables = table_views(rows, ["I"]) if chosen else []
        shown = Tables(tuple(tables), tuple(rows))
        monkeypatch.setattr("benchmark.cli.run.tables_of_run", lambda *_, t=shown, **__: t)
        planned = Plan(tmp_path, tuple(SimpleNamespace(record=row) for row in rows), ())
        _print_tables(planned, rows, Selection(data=list(chosen), results=tmp_path))
        said = capsys.readouterr().err
        assert proposed in said
        assert bool(said) == bool(proposed)


def test_a_named_data_set_without_a_job_is_named_beside_the_table(results):
    write_record(results, record("gps", dataset="balls", input_="view"))
    words = ("--results", results, "-d", "rods", "-d")
    for verb in (("tables",), ("compare", "gps", "skeleton")):
        for name, more in (("roods", ()), ("balls", ("--input", "mesh"))):
            said = call(*verb, *words, name, *more)
            assert f"no finished job on {name} fits the selection" in said
    assert "no finished job on" not in call("tables", *words, "balls")
    assert "no finished job on" not in refusal("tables", "--results", results, "-d", "roods")


def test_a_comparison_names_a_table_that_is_named_without_a_job():
    notes = benchmark.compare("gps", "identity", tables=["III", "shrec15"], published=True).attrs
    (note,) = notes["notes"]
    assert note == "not shown: table shrec15, of which no finished job fits the selection"


@pytest.mark.parametrize("selected", [{"methods": ["gps", "gsp"]}, {"data": ["rods", "roods"]}])
def test_forget_deletes_nothing_if_one_of_its_names_is_of_no_record(results, selected):
    (wrong,) = {"gsp", "roods"} & {*next(iter(selected.values()))}
    before = sorted(results.rglob("*"))
    with pytest.raises(ConfigurationError, match=f"no record under .* is of {wrong}"):
        forget(results=results, yes=True, **selected)
    assert sorted(results.rglob("*")) == before


def test_scores_are_those_of_the_rows_of_a_table_and_of_its_columns():
    def inputs(table, method):
        found = benchmark.tables(table, methods=method, published=True).scores
        return {(line.table, line.input) for line in found.itertuples()}

    assert inputs("III", "gps") == {("III", "mesh"), ("III", "paper"), ("III-view", "view")}
    assert inputs("III-view", "gps") == {("III-view", "view")}
    ablation = benchmark.tables("IV", published=True)
    rows = {row.method for view in ablation.views for row in view.printed_rows}
    assert {*ablation.scores.method} == rows


def test_scores_of_another_version_of_the_data_are_in_no_table_and_averaged_with_no_other(results):
    old = {"labels": LABELS[:8], "gallery_digest": "0", "finished": "2025-01-01T00:00:00+00:00"}
    write_record(results, record("net", 0.25, **old))
    write_record(results, record("net[training_seed=1]", 0.75))

    def values(scores):
        return scores.query("method == 'net' and measure == 'NN'").value.tolist()

    tables = benchmark.tables(results=results)
    assert "net on rods, mesh" in tables.markdown()
    assert values(tables.scores) == [0.75]
    assert values(benchmark.tables("rods", results=results).scores) == [0.75]
    assert values(benchmark.open_results(results).scores) == [0.25, 0.75]


@pytest.mark.parametrize(
    ("methods", "tables", "message"),
    [
        (["gps", "learned"], ["III"], "learned has no row in the selected tables"),
        (["gps"], ["I", "III"], "table I has no job in this selection"),
        (["gps"], ["III", "III-view"], "table III-view has no job in this selection"),
        (["gps"], ["III"], ""),
    ],
)
def test_a_method_or_table_that_is_named_and_has_no_job_is_refused_beside_others(
    tmp_path, methods, tables, message
):
    selected = {"quick": True, "input": "mesh", "results": tmp_path}
    if message:
        with pytest.raises(ConfigurationError, match=message):
            benchmark.plan("animals", methods, tables=tables, **selected)
    else:
        assert len(benchmark.plan("animals", methods, tables=tables, **selected).jobs) == 1


def test_a_data_set_that_is_refused_lets_the_tables_of_others_run(tmp_path):
    """Each is tried alone, and fills one of the tables."""
    planned = benchmark.plan(
        ["animals", "humans-scanlike", tmp_path / "none"],
        "gps",
        tables=["II", "III"],
        input="mesh",
        results=tmp_path,
    )
    assert [*planned.refused] == [str(tmp_path / "none")]
    assert {job.record.data.name for job in planned.jobs} == {"animals", "humans-scanlike"}

"""A run returns what was asked: code and shapes of today, under planned keys, whatever ran before
or meanwhile.
"""

from __future__ import annotations

import os
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import benchmark
from benchmark.datasets import mesh_files
from benchmark.errors import ConfigurationError
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records
from benchmark.runs.planning import plan_selection
from benchmark.runs.runner import with_results
from tests.registry.plugin import write_plugin
from tests.runs.toy import FAULTS, LIGHT, LIGHT_SCORER, done, planned, run_toy
from tests.toy import rod, write_off, write_rods
from tests.verbs import call, refusal

STRETCHED = (
    "def canonicalise(self, shape):\n        return shape.form(shape.mesh.vertices**3 * factor())"
)


@pytest.fixture
def own(tmp_path, monkeypatch, in_this_process):
    """A folder of rods of one's own, and the current folder; runs from Python start no workers."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return write_rods(tmp_path / "rods", bends=(0.0, 1.0))


def distances_of(folder, method, results="results", plugins=(), **options):
    """Run a method on surfaces from Python; return its distances."""
    options |= {
        "scorer": "light",
        "plugins": [*plugins, LIGHT_SCORER],
        "input": "mesh",
    }
    jobs = benchmark.run(folder, method, results=results, **options)
    assert list(jobs["status"]) == ["ok"], jobs["reason"].tolist()
    return benchmark.open_results(results).distances(jobs.index[0])


@pytest.fixture(scope="module")
def stretched(rods, tmp_path_factory):
    """Return a function that returns the distances of rods that are stretched; each is computed
    once.
    """

    @cache
    def distances(*factors):
        def method(shape):
            return shape.mesh.vertices**3 * factors

        (record,) = run_toy(rods, folder := tmp_path_factory.mktemp("stretched"), method).values()
        return read_distances(folder, record)

    return distances


def test_an_edited_plugin_or_helper_is_imported_again_by_the_next_run_of_a_session(
    own, tmp_path, stretched
):
    plugin, helper = tmp_path / "smooth.py", tmp_path / "lengthening.py"
    write_plugin(plugin, imports="from lengthening import factor", methods=STRETCHED)
    for number, factor in enumerate(("[1, 1, 1]", "[3, 1, 1]", "[1, 1, 5]")):
        helper.write_text(f"def factor():\n    return {factor}\n")
        if number == 2:
            plugin.write_text(plugin.read_text().replace("* factor()", "* factor()[::-1]"))
        expected = (5, 1, 1) if number == 2 else eval(factor)  # noqa: S307
        np.testing.assert_array_equal(
            distances_of(own, "smooth", plugins=[plugin]), stretched(*expected)
        )


def sub_folder(folder):
    (folder / "parts").mkdir()
    return folder / "parts" / "deep.py", "from parts.deep import FACTOR", ""


def on_the_path(folder):
    (folder / "elsewhere").mkdir()
    return (
        folder / "elsewhere" / "far.py",
        "import sys; sys.path.append({!r}); from far import FACTOR".format(
            str(folder / "elsewhere")
        ),
        "",
    )


def named_file(folder):
    read = (
        "from pathlib import Path; "
        "FACTOR = float(Path(__file__).with_name('named.txt').read_text().split()[-1])"
    )
    return folder / "named.txt", read, 'files=("named.txt",)'


def of_the_same_second(folder):
    return folder / "quick.py", "from quick import FACTOR", ""


def by_a_link(folder):
    (folder / "linked.py").symlink_to(folder / "kept.txt")
    return folder / "kept.txt", "from linked import FACTOR", ""


@pytest.mark.parametrize(
    "place", [sub_folder, on_the_path, named_file, of_the_same_second, by_a_link]
)
def test_what_a_plugin_imports_is_in_its_key_and_of_today(
    own, tmp_path, monkeypatch, place, stretched
):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    file, imports, info = place(tmp_path)
    methods = STRETCHED.replace("factor()", "[1, 1, FACTOR]")
    plugin = write_plugin(tmp_path / "smooth.py", imports=imports, info=info, methods=methods)
    for number, factor in enumerate((1, 5)):
        file.write_text(f"FACTOR = {factor}\n")
        os.utime(file, ns=(10**18, 10**18 + number))
        np.testing.assert_array_equal(
            distances_of(own, "smooth", plugins=[plugin]), stretched(1, 1, factor)
        )


def test_a_helper_that_is_written_after_its_import_failed_counts_from_then_on(own, tmp_path):
    plugin = write_plugin(
        tmp_path / "smooth.py", imports="from belated import factor", methods=STRETCHED
    )
    with pytest.raises(ConfigurationError, match="put belated.py beside the file"):
        distances_of(own, "smooth", plugins=[plugin])
    keys = []
    for factor in (1, 7):
        (tmp_path / "belated.py").write_text(f"def factor():\n    return [1, 1, {factor}]\n")
        distances_of(own, "smooth", plugins=[plugin])
        keys += [record.key for record in read_records(tmp_path / "results", published=False)]
    assert len({*keys}) == 2


def test_code_of_the_ranking_that_is_edited_during_a_run_ranks_nothing(own, tmp_path, monkeypatch):
    jobs = planned(own, tmp_path / "results", "identity")
    monkeypatch.setattr(
        "benchmark.runs.unchanged.code_of_modules", lambda _: {"retrieval/measures.py": "edited"}
    )
    (record,) = done(jobs, tmp_path / "results").values()
    assert record.status == "incomplete"
    assert "measures.py" in record.reason
    assert "changed during the run" in record.reason


@pytest.mark.parametrize("size", [0, 1])
def test_a_plugin_that_changes_the_current_folder_leaves_results_where_they_belong(
    own, tmp_path, size
):
    moves = (
        "def canonicalise(self, shape):\n        os.chdir('/')\n"
        "        return shape.form(shape.mesh.vertices)"
    )
    write_plugin(tmp_path / "smooth.py", imports="import os; os.chdir('/')", methods=moves)
    call(
        "run",
        "-d",
        "rods",
        "-m",
        "smooth",
        "--plugin",
        "smooth.py",
        "--input",
        "mesh",
        *LIGHT,
        "-j",
        size,
    )
    assert len(read_records(tmp_path / "results", published=False)) == 1
    assert Path.cwd() == tmp_path


def test_meshes_that_are_written_again_or_added_in_a_session_are_seen(own, tmp_path):
    first = distances_of(own, "surface-area")
    write_off(own / "thin1.off", rod(0.06, 0.3))
    write_off(own / "thick2.off", rod(0.18, 2.0))
    second = distances_of(own, "surface-area")
    assert list(second.index) == ["thick0", "thick1", "thick2", "thin0", "thin1"]
    assert second.equals(distances_of(own, "surface-area", tmp_path / "clean"))
    assert not second.loc[first.index, first.index].equals(first)


@pytest.mark.parametrize("size", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_shape_that_is_not_the_planned_one_leaves_nothing(own, tmp_path, size):
    results, mesh = tmp_path / "results", own / "thin1.off"
    jobs, original = planned(own, results, "gps", input=None), mesh.read_bytes()
    write_off(mesh, rod(0.06, 0.3))
    records = done(jobs, results, size=size)
    assert {record.status for record in records.values()} == {"incomplete"}
    assert {record.reason for record in records.values()} <= {
        # all views share a frame, which is fitted to all shapes
        "thin1 changed during the run; run again",
        *(
            f"{name} changed during the run; run again (and {n} more)"
            for name in ("thick0", "thick1", "thin0")
            for n in (1, 2, 3)
        ),
    }
    mesh.write_bytes(original)
    records = run_toy(own, results, "gps", input=None)
    clean = run_toy(own, tmp_path / "clean", "gps", input=None)
    assert {name: (r.status, r.key, r.per_query) for name, r in records.items()} == {
        name: ("ok", r.key, r.per_query) for name, r in clean.items()
    }


@pytest.mark.parametrize(
    "view", ["mesh", "view"]
)  # of views, the frame of the camera reads it first
def test_a_mesh_that_changes_while_it_is_read_is_read_again(own, tmp_path, monkeypatch, view):
    real, original = mesh_files.read_mesh, (own / "thin1.off").read_bytes()
    seen = []

    def change_meanwhile(path):
        if path.name == "thin1.off" and not seen:
            seen.append(path)
            write_off(path, rod(0.5, 0.3))
            mesh = real(path)
            path.write_bytes(original)
            return mesh
        return real(path)

    monkeypatch.setattr("benchmark.datasets.mesh_files.read_mesh", change_meanwhile)
    record = run_toy(own, tmp_path / "results", "gps", input=view)["gps"]
    assert seen
    clean = run_toy(own, tmp_path / "clean", "gps", input=view)["gps"]
    assert (record.status, record.per_query) == ("ok", clean.per_query)


@pytest.mark.parametrize("size", [0, 1])
def test_an_edit_of_a_plugin_during_a_run_leaves_its_job_incomplete_alone_and_its_scores(
    rods, tmp_path, size
):
    plugin, results = tmp_path / "edited.py", tmp_path / "results"
    plugin.write_text(FAULTS.read_text())
    run_toy(rods, results, "fine", plugins=(plugin,))
    scored = read_records(results)
    plugin.write_text(FAULTS.read_text() + "CONSTANT = 0\n")
    jobs = planned(rods, results, "fine", "identity", plugins=(plugin,))
    plugin.write_text(FAULTS.read_text() + "CONSTANT = 1\n")
    records = done(jobs, results, size=size) if size else done(jobs, results)
    assert [record for record in read_records(results) if record.method == "fine"] == scored
    assert {name: record.status for name, record in records.items()} == {
        "fine": "incomplete",
        "identity": "ok",
    }
    assert (
        records["fine"].reason
        == "edited.py changed during the run, or is another one on this machine; run again"
    )


def test_force_computes_forms_anew_and_replaces_scores_by_scores_alone(own, tmp_path):
    table, results = tmp_path / "table.txt", tmp_path / "results"
    table.write_text("1 1 1")
    methods = STRETCHED.replace(
        "factor()", f"[float(x) for x in open({str(table)!r}).read().split()]"
    )
    plugin = write_plugin(tmp_path / "smooth.py", methods=methods)
    first = distances_of(own, "smooth", plugins=[plugin])
    table.write_text("1 1 7")
    assert distances_of(own, "smooth", plugins=[plugin]).equals(first)
    assert not distances_of(own, "smooth", plugins=[plugin], again=True).equals(first)
    before = read_records(results)
    table.write_text("nothing")
    jobs = benchmark.run(own, "smooth", plugins=[plugin, LIGHT_SCORER], scorer="light", again=True)
    assert list(jobs["status"]) == ["failed"]
    assert read_records(results) == before


def test_what_cannot_run_replaces_no_record(own, tmp_path):
    info = 'requires=("benchmark_absent",)'
    plugin = write_plugin(tmp_path / "smooth.py")
    distances_of(own, "smooth", plugins=[plugin])
    before = read_records(tmp_path / "results", published=False)
    write_plugin(plugin, info=info)
    options = ("run", "-d", own, "--input", "mesh", *LIGHT, "-m", "smooth", "--plugin", plugin)
    told = call(*options, code=1)
    assert "unavailable  rods mesh smooth by light  needs benchmark_absent" in told
    assert read_records(tmp_path / "results", published=False) == before
    jobs = planned(own, tmp_path / "results", "smooth", plugins=(plugin,))
    assert [job.state for job in jobs] == ["unavailable"]
    assert with_results(before, jobs, {}) == before, "the result of the row stands alone"


def test_no_package_is_named_for_an_input_that_a_method_never_takes(own, tmp_path):
    info = 'requires=("benchmark_absent",), inputs=("view",)'
    plugin = write_plugin(tmp_path / "smooth.py", info=info)
    states = {
        input_: planned(own, tmp_path / "results", "smooth", plugins=(plugin,), input=input_)[0]
        for input_ in ("mesh", "view")
    }
    assert states["mesh"].reason == "does not take the mesh input"
    assert states["view"].reason.startswith("needs benchmark_absent: ")


def paths_and_states(folder, results):
    run_toy(folder, results, "identity")
    return sorted(
        (Path(record.data.path).parent.name, record.status) for record in read_records(results)
    )


def test_a_folder_is_what_lies_at_its_path(tmp_path):
    results = tmp_path / "results"
    one, two = (
        write_rods(tmp_path / name / "rods", bends=(0.0, bend))
        for name, bend in (("a", 1.0), ("b", 0.5))
    )
    paths_and_states(one, results)
    assert paths_and_states(two, results) == [("a", "ok"), ("b", "ok")]
    write_off(two / "thin1.off", rod(0.06, 0.3))
    assert paths_and_states(two, results) == [("a", "ok"), ("b", "ok")], (
        "a change replaces its own record"
    )
    copy = shutil.copytree(one, tmp_path / "c" / "rods")
    forms = sorted((results / "runs" / "forms").iterdir())
    assert paths_and_states(copy, results) == [("a", "ok"), ("b", "ok"), ("c", "ok")]
    assert sorted((results / "runs" / "forms").iterdir()) == forms, (
        "a copy is ranked from the forms of the original"
    )
    first, *_, last = sorted(read_records(results), key=lambda record: record.data.path)
    assert first.per_query == last.per_query


@pytest.fixture(scope="module")
def of_one_name(tmp_path_factory):
    """A folder with results of a/x/rods and b/x/rods, to be read only."""
    folder = tmp_path_factory.mktemp("of-one-name")
    for name, bend in (("a/x", 1.0), ("b/x", 0.5)):
        rods = write_rods(folder / name / "rods", bends=(0.0, bend))
        run_toy(rods, folder / "results", "identity", scorer="cm-bof")
    return folder


def test_data_sets_of_one_name_are_called_by_their_folders(of_one_name):
    records = label_data_sets(read_records(of_one_name / "results"))
    assert {record.data.name for record in records} == {"a/x/rods", "b/x/rods"}


def test_a_table_shows_the_data_set_that_a_path_or_a_label_names(of_one_name, monkeypatch):
    monkeypatch.chdir(of_one_name / "a")
    words = ("tables", "--results", of_one_name / "results", "-d")
    table = call(*words, of_one_name / "b" / "x" / "rods")
    assert "b/x/rods" in table
    assert "a/x/rods" not in table
    assert call(*words, "b/x/rods") == table


def test_data_sets_of_one_name_have_tables_of_their_own(of_one_name, tmp_path):
    call("tables", "--results", of_one_name / "results", "-o", tmp_path)
    names = sorted(path.name for path in tmp_path.glob("table-*.md"))
    assert [name[:14] for name in names] == ["table-a-x-rods", "table-b-x-rods"]


def test_a_name_of_several_data_sets_is_refused(of_one_name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ("tables", "--results", of_one_name / "results", "-d", "rods")
    assert refusal(*words) == (
        f"'rods' names results of {of_one_name}/a/x/rods and of {of_one_name}/b/x/rods; "
        "pass the path that you mean"
    )
    write_rods(tmp_path / "rods", bends=(0.0, 2.0))
    assert f"'rods' names results of {tmp_path}/rods and of {of_one_name}/a/x/rods" in refusal(
        *words
    )


def test_one_of_several_data_sets_of_a_name_is_forgotten(of_one_name, tmp_path, monkeypatch):
    results = shutil.copytree(of_one_name / "results", tmp_path / "results")
    monkeypatch.chdir(of_one_name)
    call("forget", "--results", results, "-d", "a/x/rods", "--yes")
    kept = [record.data.path for record in read_records(results)]
    assert kept == [str(of_one_name / "b" / "x" / "rods")]


def test_a_plan_has_a_job_once_with_all_tables_that_show_it(tmp_path):
    jobs = plan_selection(tmp_path, tables=["I"], methods=["learned"])
    shown = {
        (table.table.identifier, job.record.gallery) for job in jobs for table in job.galleries
    }
    assert {("I", "people[draw=0]"), ("I-view", "people[draw=0]")} <= shown
    assert len({job.record.key for job in jobs}) == len(jobs)

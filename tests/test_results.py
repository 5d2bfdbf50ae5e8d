"""Results as data frames and arrays, through the public module."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import benchmark
from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.pipeline.storage.records import as_text
from benchmark.pipeline.storage.store import StorageError
from benchmark.results import open_results
from retrieval.metrics import evaluate
from tests.records import published as published_records
from tests.toy import write_rods

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Identity, shape-dna and a method that always fails on rods, the first one under two seeds."""
    place = tmp_path_factory.mktemp("results")
    write_rods(place / "rods")
    (place / "fails.py").write_text(
        "from benchmark.api.contracts import canonical_form\n"
        "@canonical_form(name='fails', title='Fails', inputs=('mesh',))\ndef fails(shape):\n    1 / 0\n"
    )
    run = ["run", "-d", str(place / "rods"), "--input", "mesh", "-j", "0", "--results", str(place)]
    CliRunner().invoke(cli, [*run, "-m", "identity", "-m", "shape-dna", "--plugin", str(place / "fails.py")])
    CliRunner().invoke(cli, [*run, "-m", "identity", "--seed", "1"])
    return place


@pytest.fixture(scope="module")
def results(folder):
    return open_results(folder)


def key_of(results, method, seed=0):
    records = results.records()
    return records[(records["method"] == method) & (records["seed"] == seed)].index[0]


@pytest.mark.slow
def test_distances_give_the_scores_again(results):
    key = key_of(results, "identity")
    matrices = results.distance_matrices(key)
    assert matrices.shape == (3, 6, 6)
    subjects = list(results.queries(key)["subject"])
    scores = [evaluate(matrix, subjects).means["NN"] for matrix in matrices]
    assert np.mean(scores) == pytest.approx(results.records().loc[key, "NN"])
    assert results.distance_matrices(key_of(results, "shape-dna")).shape == (1, 6, 6)


@pytest.mark.slow
def test_what_is_not_there_is_named(results, folder, tmp_path):
    with pytest.raises(ConfigurationError, match="holds no record 'abc'; take a key from records"):
        results.distances("abc")
    with pytest.raises(ConfigurationError, match="identity describes no shapes; ask for its forms"):
        results.descriptors(key_of(results, "identity"))
    with pytest.raises(ConfigurationError, match="has no scores: failed; choose a finished one"):
        results.queries(key_of(results, "fails"))
    with pytest.raises(StorageError, match="none is no folder; name a results folder"):
        open_results(tmp_path / "none")
    (tmp_path / "records").mkdir()
    for path in (folder / "runs" / "records").iterdir():
        (tmp_path / "records" / path.name).write_bytes(path.read_bytes())
    elsewhere = open_results(tmp_path)
    key = key_of(elsewhere, "identity")
    for ask in (elsewhere.distances, elsewhere.forms):
        with pytest.raises(StorageError, match="are not in .*: made elsewhere, or freed; run it again here"):
            ask(key)


@pytest.mark.slow
def test_a_script_with_a_plugin_needs_no_guard(folder, tmp_path):
    """Plugin files are looked at in a process of their own, which must not run the script again."""
    (tmp_path / "script.py").write_text(
        "from benchmark.results import open_results\n"
        f"results = open_results({os.fspath(folder)!r}, plugins=[{os.fspath(folder / 'fails.py')!r}])\n"
        "print(len(results.records()))\n"
    )
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
    assert (done.stdout, done.stderr) == ("4\n", "")


def test_jobs_done_here_are_passed_over_where_published_ones_are_wanted(tmp_path):
    (tmp_path / "records").symlink_to(ROOT / "results" / "records")
    published = open_results(tmp_path).records()
    key = published.query("gallery == 'tosca' and method == 'surface-area' and input == 'mesh'").index[0]
    (record,) = (each for each in published_records() if each["key"] == key)
    (tmp_path / "runs" / "records").mkdir(parents=True)
    changed = record | {"finished": "2099", "peak_mib": 4321.5}
    write_text(tmp_path / "runs" / "records" / f"{key}.json", as_text(changed))
    assert open_results(tmp_path).records().loc[key, "finished"] == "2099"
    assert open_results(tmp_path, published=True).records().equals(published)

    def tables(*more):
        done = CliRunner().invoke(cli, ["tables", "-t", "III", "-d", "tosca", "--results", str(tmp_path), *more])
        assert done.exit_code == 0, done.output
        return done.output

    asked = ("-m", "surface-area", "--format", "json")
    assert '"peak_mib": 4321.5' in tables(*asked)
    assert '"peak_mib": 4321.5' not in tables(*asked, "--published")
    tables("-o", str(tmp_path / "tables"))
    assert '"peak_mib": 4321.5' not in (tmp_path / "tables" / "tables.json").read_text()
    tables("-o", str(tmp_path / "tables"), "--check")
    tables("-o", str(tmp_path / "mine"))
    assert '"peak_mib": 4321.5' in (tmp_path / "mine" / "tables.json").read_text()


@pytest.mark.slow
def test_a_run_from_python_returns_its_records_resumes_and_raises_what_the_command_line_refuses(
    folder, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    selection = {"data": folder / "rods", "methods": ["identity"], "input": "mesh", "plugin": folder / "fails.py"}
    records = benchmark.run(**selection, results=tmp_path)
    assert list(records["status"]) == ["ok", "failed"]
    assert "1 of 2 jobs to run" not in capsys.readouterr().out
    assert benchmark.run(**selection, results=tmp_path)["finished"].equals(records["finished"])
    assert "0 of 2 jobs to run, 1 finished before" in capsys.readouterr().out
    assert len(open_results(tmp_path, plugins=[folder / "fails.py"]).distances(records.index[0])) == 6
    forms = benchmark.run(folder / "rods", forms=f"Mine={folder / 'rods'}", results=tmp_path, input="mesh")
    assert "external-mine" in set(forms["method"])
    with pytest.raises(ConfigurationError, match="unknown data set 'nowhere'") as caught:
        benchmark.run("nowhere", "identity")
    assert caught.value.hint.startswith("choose one of")

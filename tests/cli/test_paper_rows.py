"""``--paper``: the rows that the paper prints, and no other."""

import re

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.reference import paper


def call(*words):
    return CliRunner().invoke(cli, list(words), catch_exceptions=True)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Gallery, input and method of each job, and the states of the jobs."""
    folder = str(tmp_path_factory.mktemp("results"))
    lines = {
        words: call("plan", *words, "--data-root", folder, "--results", folder, "--all-jobs").output.splitlines()
        for words in ((), ("--paper",))
    }
    states = ("missing", "unsupported", "unavailable")
    return {words: {re.split(" {2,}", line)[1] for line in found if line.split(" ")[0] in states}
            for words, found in lines.items()}  # fmt: skip


def test_rows_of_the_paper_are_planned_alone_and_all_of_them(planned):
    whole, found = planned[()], planned["--paper",]
    assert found < whole
    galleries = {name.rpartition(" ")[0].rpartition(" ")[0] for name in found}
    assert not {name for name in galleries if "held out" in name or name == "humans"}
    of_people = {name.rpartition(" ")[2] for name in found if name.startswith("humans-scanlike mesh")}
    assert of_people == {row.method for row in paper.ROWS}
    of_folds = {name.rpartition(" ")[2].partition("[training_seed=")[0] for name in found if "fold 0 view" in name}
    assert of_folds == {row.method for row in (*paper.ROWS, *paper.ABLATION)}
    assert not [name for name in found if "[" in name and "[training_seed=" not in name]
    missing = whole - found
    assert {"humans view classic-mds", "animals mesh fast-mds", "humans fold 0 view learned-streamed"} <= missing


@pytest.mark.parametrize("words", [("-m", "fast-mds"), ("-t", "III-held-out")])
def test_a_selection_without_a_row_of_the_paper_is_told(tmp_path, words):
    for verb in ("plan", "run"):
        error = call(verb, "--paper", *words, "--data-root", str(tmp_path), "--results", str(tmp_path)).exception
        assert isinstance(error, ConfigurationError)
        assert "no row of the paper is selected; drop --paper" in str(error)


def test_a_run_of_the_paper_needs_no_further_choice(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("benchmark.cli.run.run_plan", lambda jobs, *_: asked.extend(jobs) or True)
    done = call("run", "--paper", "--input", "view", "--quick", "--results", str(tmp_path))
    assert done.exit_code == 0
    assert {job.method.name for job in asked} == {row.method for row in paper.ROWS}

"""The suite as its users meet it: through the command line."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.toy import write_rods

ROOT = Path(__file__).parents[2]
SCORES = ("table", "dataset", "input", "method", "NN", "FT", "ST", "DCG", "n_shapes", "unsupported", "status")
METHODS = ("-m", "identity", "-m", "classic-mds", "-m", "surface-area")


def command(*arguments):
    return [sys.executable, "-m", "benchmark", *map(str, arguments)]


def benchmark(*arguments, env=None, **options):
    clean = {name: value for name, value in os.environ.items() if name != "CANONICAL_FORMS_DATA"}
    return subprocess.run(
        command(*arguments),
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=280,
        check=False,
        env=clean | (env or {}),
        **options,
    )


def scores(arguments):
    rows = json.loads(benchmark("tables", *arguments, "--format", "json").stdout)
    return [{name: row[name] for name in SCORES} for row in rows]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished run of three methods on both inputs, two jobs at a time."""
    folder = tmp_path_factory.mktemp("finished")
    arguments = ("-d", write_rods(folder / "rods"), *METHODS, "--results", folder / "results")
    return arguments, benchmark("run", *arguments, "-j", 2)


def test_help_and_lists_answer_at_once():
    # Time of the processor, for the machine may be busy; best of three, for the first call may write bytecode.
    for arguments, limit in (("--help",), 0.3), (("list", "methods"), 0.5):
        seconds = []
        for _ in range(3):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            assert benchmark(*arguments).returncode == 0
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        assert min(seconds) < 2 * limit


def test_the_help_of_a_verb_imports_none():
    program = """
import sys
from typer.testing import CliRunner
from benchmark.cli.main import cli
from typer.main import get_command
for name, command in get_command(cli).commands.items():
    for words in [[name], *([name, inner] for inner in getattr(command, "commands", ()))]:
        assert CliRunner().invoke(cli, [*words, "--help"]).exit_code == 0
print({"numpy", "scipy", "pandas", "torch", "rich"} & sys.modules.keys())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "set()\n"


@pytest.mark.slow
def test_a_run_killed_in_the_middle_goes_on_where_it_was(finished, tmp_path):
    arguments, _ = finished
    other = (*arguments[:-1], tmp_path / "killed")
    process = subprocess.Popen(
        command("run", *other, "-j", "1"),
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    folder = tmp_path / "killed" / "runs" / "records"
    deadline = time.monotonic() + 200
    while len(list(folder.glob("*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.json")}
    assert 2 <= len(kept) < 6
    again = benchmark("run", *other)
    assert again.stdout.startswith(f"{6 - len(kept)} of 6 jobs to run, {len(kept)} finished before")
    assert kept == {name: (folder / name).stat().st_mtime_ns for name in kept}
    assert scores(other) == scores(arguments)


@pytest.mark.slow
@pytest.mark.data
def test_cats_and_horses_of_tosca_are_told_apart(data_root, tmp_path):
    arguments = ("-t", "III-held-out", "--input", "mesh", "-m", "classic-mds", "--data-root", data_root)
    done = benchmark("run", *arguments, "--results", tmp_path)
    assert done.returncode == 0, done.stderr
    told = benchmark("tables", *arguments, "--results", tmp_path, "--format", "json").stdout
    row = next(row for row in json.loads(told) if row["method"] == "classic-mds")
    assert (row["dataset"], row["n_shapes"], row["n_classes"]) == ("tosca", 19, 2)
    assert row["NN"] >= 0.9

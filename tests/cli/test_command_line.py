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

PLUGIN = '''
from dataclasses import dataclass
from typing import ClassVar

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Stretch a shape along one axis."""

    info: ClassVar[MethodInfo] = MethodInfo(name="stretch", title="Stretched")
    factor: float = 2.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        return shape.form(shape.mesh.vertices * [self.factor, 1, 1])
'''


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
def rods(tmp_path_factory):
    return write_rods(tmp_path_factory.mktemp("data") / "rods")


@pytest.fixture(scope="module")
def finished(rods, tmp_path_factory):
    """A finished run of three methods on both inputs, two jobs at a time."""
    arguments = ("-d", rods, *METHODS, "--results", tmp_path_factory.mktemp("results"))
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
from click.testing import CliRunner
from benchmark.cli.main import cli
for name, command in cli.commands.items():
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


SLOW_PLUGIN = """
import time
from benchmark.api.contracts import canonical_form

@canonical_form(name="slow", title="Slow")
def slow(shape):
    time.sleep(0.4)
    return shape.mesh.vertices
"""


@pytest.mark.slow
def test_an_interrupted_run_says_what_is_kept_and_keeps_it(rods, tmp_path):
    (tmp_path / "slow.py").write_text(SLOW_PLUGIN)
    arguments = ("-d", rods, "-m", "slow", "--plugin", tmp_path / "slow.py", "--input", "mesh", "-j", "1")
    arguments = (*arguments, "--results", tmp_path / "results")
    runs = tmp_path / "results" / "runs"
    process = subprocess.Popen(
        command("run", *arguments), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    deadline = time.monotonic() + 100
    while len(list(runs.glob("artefacts/*/*.npz"))) < 4 and time.monotonic() < deadline:  # two shapes and their forms
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1] == ("interrupted; finished jobs are kept, finished shapes too: run again to continue")
    assert not list((runs / "records").glob("*.json"))
    kept = {path: path.stat().st_mtime_ns for path in runs.glob("artefacts/*/*.npz")}
    assert len(kept) >= 4
    assert benchmark("run", *arguments).returncode == 0
    assert kept == {path: path.stat().st_mtime_ns for path in kept}


@pytest.mark.slow
def test_a_plugin_file_appears_as_a_row_and_costs_only_itself(finished, tmp_path):
    arguments, _ = finished
    (tmp_path / "stretch.py").write_text(PLUGIN)
    done = benchmark("run", *arguments, "--plugin", tmp_path / "stretch.py")
    assert done.stdout.startswith("2 of 8 jobs to run, 6 finished before")
    assert "| Stretched" in done.stdout
    plan = benchmark("plan", *arguments, "--plugin", tmp_path / "stretch.py")
    assert plan.stdout.endswith("0 of 8 jobs to run\n")
    (tmp_path / "stretch.py").write_text(PLUGIN.replace("2.0", "3.0"))
    changed = benchmark("plan", *arguments, "--plugin", tmp_path / "stretch.py").stdout
    assert "parameters changed: factor 2.0 -> 3.0; plugin changed: stretch.py " in changed
    assert changed.endswith("2 of 8 jobs to run\n")


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


@pytest.mark.exhaustive
@pytest.mark.data
def test_tosca_agrees_with_the_measured_level(data_root, tmp_path):
    arguments = ("-d", "tosca", "--input", "mesh", "-m", "classic-mds", "--data-root", data_root, "--results", tmp_path)
    done = benchmark("run", *arguments)
    assert done.returncode == 0, done.stderr
    row = next(
        row
        for row in json.loads(benchmark("tables", *arguments, "--format", "json").stdout)
        if row["method"] == "classic-mds"
    )
    assert (row["n_shapes"], row["n_classes"]) == (80, 9)
    assert 0.75 <= row["NN"] <= 0.95
    assert row["DCG"] > 0.80
    assert row["paper"] == {"NN": 0.74, "FT": 0.54, "ST": 0.80, "DCG": 0.80}

"""The command line as a whole: its size, what it imports, what it refuses, and what it never
overwrites.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.commands.selection import shadowed_folders
from benchmark.pipeline.record_files import write_record
from benchmark.text import say
from tests.report.records import record
from tests.runs.toy import without_processes
from tests.toy import PATIENCE, write_rods
from tests.verbs import VERBS, call, refusal

EXAMPLE_SCORER = Path(__file__).parents[2] / "examples/distance_distribution.py"
ALL = {**VERBS, **{f"data {name}": verb for name, verb in VERBS["data"].commands.items()}}


@pytest.mark.parametrize("name", ALL)
def test_the_help_of_a_verb_fits_a_screen(name):
    done = CliRunner().invoke(
        cli, [*name.split(), "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"}
    )
    assert done.exit_code == 0
    assert len(done.output.splitlines()) <= 45
    assert "..." not in done.output.partition("Commands:")[2]


def test_the_list_of_verbs_says_in_whole_sentences_what_each_does():
    done = CliRunner().invoke(cli, ["--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"})
    lines = done.output.partition("Commands:")[2].strip().splitlines()
    assert len(lines) == len(VERBS)
    assert [line for line in lines if not line.endswith(".") or line.endswith("..")] == []


def test_there_are_few_verbs_and_options():
    options = {
        option
        for verb in ALL.values()
        for p in verb.params
        for option in p.opts
        if option.startswith("--")
    }
    assert len(VERBS) <= 17
    assert len(options) <= 47


def test_a_command_imports_what_it_needs():
    program = """
import sys
from typer.testing import CliRunner
from benchmark.cli.main import cli
for words, unused in (
    ("run --help", {"numpy", "scipy", "pandas", "torch", "matplotlib"}),
    ("plan -d animals -m gps --quick --results none", {"torch", "matplotlib", "plotly"}),
    ("plan -d people -m gps --quick --results none", {"torch", "anny", "warp"}),
):
    assert CliRunner().invoke(cli, words.split()).exit_code == 0
    print(unused & sys.modules.keys())
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    )
    assert done.stdout == 3 * "set()\n"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["tables", "-o", ""], "--output is empty"),
        (["report", "--output="], "--output is empty"),
        (["tables", "-m", "gps", "-m", ""], "--method is empty"),
        (["compare", "gps", ""], "B is empty"),
        (["merge", "a", ""], "DIR is empty"),
        (["tables", "--results=~/none"], "--results: no shell has replaced the ~ of '~/none'"),
        (["data", "export", "~/rods", "-o", "new"], "no shell has replaced the ~ of '~/rods'"),
    ],
)
def test_what_a_shell_left_empty_or_did_not_replace_is_refused(
    tmp_path, monkeypatch, words, reason
):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 2
    assert reason in done.output
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("train learned --hold-out ben", "held out of your own data; name them, too, with --data"),
        ("train learned -t II --data scans", "scans are your own data, and 'II' names others"),
        ("score D.csv --labels a.txt --input view", "--input names the input of a row"),
        ("score D.csv --labels a.txt --dataset x", "--dataset names the data of a row"),
        ("retrieve q.off -m gps -d a --gallery-views 3 --input mesh", "omit --gallery-views or"),
        ("run --all -d a", "--all selects all tables; drop --all, or -t and -d"),
        ("plan --all -t IV", "--all selects all tables; drop --all, or -t and -d"),
        ("run -d a --forms x=forms --train", "scores forms that need no model; drop --train"),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(tmp_path, monkeypatch, line, reason):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "q.off").touch()
    assert reason in refusal(*line.split())


def test_what_a_report_cannot_use_is_refused_before_it_is_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.report.pages.report_files", None)
    write_record(tmp_path, record("gps"), "")
    (tmp_path / "file").touch()
    words = ("report", "--results", tmp_path)
    assert "file is not a folder; choose another" in refusal(*words, "-o", tmp_path / "file")
    for figure in ((), ("--figure", "map")):
        said = refusal(*words, "--shape", "cat0", *figure)
        assert "--shape names shapes of a figure of forms; pass --figure forms" in said


#: The program, in which a verb sends itself the signal of a terminal that is closed.
HANGS_UP = """
import os, signal, sys
from benchmark.cli import main
from benchmark.commands import export, models
def hang_up(*words, **options):
    with open("began", "w"):
        os.kill(os.getpid(), signal.SIGHUP)
        print("goes on")
        raise SystemExit(0)
export.export = models.fetch_models = hang_up
main.program()
"""


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("data export rods -o new", "interrupted; run again\n"),
        (
            "models fetch --from .",
            "interrupted; fetched models are kept: run again to continue\n",
        ),
    ],
)
def test_a_closed_terminal_interrupts_a_command_unless_it_ignores_that(tmp_path, words, line):
    command = [sys.executable, "-c", HANGS_UP, *words.split()]
    options = {"cwd": tmp_path, "capture_output": True, "text": True, "timeout": PATIENCE}
    done = subprocess.run(command, check=False, **options)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", line)
    done = subprocess.run(["nohup", *command], check=False, **options)
    assert (done.returncode, done.stdout) == (0, "goes on\n")


@pytest.mark.parametrize("backend", ["nonsense", "module://not_installed.backend_inline"])
def test_a_command_draws_whatever_backend_a_notebook_names_to_it(tmp_path, backend):
    program = """
from benchmark.cli import main
try:
    main.program()
finally:
    import matplotlib.figure  # which raises an error if it lacks the backend
    print(matplotlib.get_backend())
"""
    done = subprocess.run(
        [sys.executable, "-c", program, "list", "tables"],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": backend},
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "agg"


def test_published_tables_are_printed_in_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results" / "runs").mkdir(parents=True)
    assert "|Classic MDS|.74 .54 .80 .80|" in call("tables", "--published", "-t", "III")


@pytest.mark.parametrize("what", ["methods", "scorers", "tables", "models", "datasets"])
def test_lists_fit_80_columns_without_broken_words(what, monkeypatch):
    monkeypatch.setenv("COLUMNS", "10000")
    words = {*call("list", what).split()}
    monkeypatch.setenv("COLUMNS", "80")
    shown = call("list", what)
    assert {*shown.split()} == words
    assert max(map(len, shown.splitlines())) <= 80


def test_a_line_is_wrapped_in_a_terminal_alone(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "30")
    say("  error: a line of more than thirty characters")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    say("  error: a line of more than thirty characters")
    whole, *wrapped = capsys.readouterr().out.splitlines()
    assert wrapped == ["  error: a line of more than", "    thirty characters"]
    assert whole == " ".join([wrapped[0], wrapped[1].strip()])


# The folder of official data
# -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "line",
    ["list methods", "list scorers", "describe gps", "compare gps identity --published -t III"],
)
def test_what_reads_no_data_does_not_look_for_it(line):
    done = CliRunner().invoke(cli, line.split(), env={"CANONICAL_FORMS_DATA": "/no/such/folder"})
    assert (done.exit_code, done.exception) == (0, None), done.output
    assert "/no/such/folder" not in done.output


# Files of the user
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [("tables",), ("compare", "gps"), ("report", "-o", "report")])
def test_quick_rows_are_shown_where_no_full_ones_are_and_named_where_they_are_newer(
    tmp_path, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    quick = [
        record(name, quick=True, finished="2026-03-01T00:00:00+00:00")
        for name in ("gps", "skeleton")
    ]
    for each in quick:
        write_record(tmp_path, each)
    words = (*words, "--results", tmp_path)
    assert "these are quick runs (rods)" in call(*words)
    assert "run it first" in refusal("tables", "--results", tmp_path, "--quick", "--seed", 1)
    for name in ("gps", "skeleton"):
        write_record(tmp_path, record(name, finished="2026-02-01T00:00:00+00:00"))
    assert "2 newer quick jobs are not shown: pass --quick (rods)" in call(
        *words, *["--force"] * (words[0] == "report")
    )
    assert "quick jobs" not in call("tables", "--results", tmp_path, "--quick")
    write_record(tmp_path, record("classic-mds", finished="2026-04-01T00:00:00+00:00"))
    assert "quick jobs" not in call("tables", "--results", tmp_path)


def test_rows_of_other_scorers_and_seeds_are_counted_with_the_way_to_them(tmp_path):
    for more in ({}, {"scorer": "bbox"}, {"seed": 3}):
        write_record(tmp_path, record("gps", **more))
    found = call("tables", "--results", tmp_path)
    assert (
        "not shown: 2 jobs of another scorer or seed: "
        "pass --scorer bbox --seed 0, or --scorer cm-bof" in found
    )
    write_record(tmp_path, record("surface-area", scorer=""))
    assert "2 jobs of" in call("compare", "gps", "--results", tmp_path)


def test_a_folder_with_the_name_of_a_set_of_the_suite_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("animals", "tosca"):
        (tmp_path / name).mkdir()
    says = (
        "animals means the data set of the suite, not the folder of this name here; "
        "for the folder, pass ./animals"
    )
    assert says in call(
        "plan", "-d", "animals", "-m", "surface-area", "--results", tmp_path / "results"
    )
    assert shadowed_folders(["./animals", "people", "tosca"], tmp_path) == []  # of the data root
    [told] = shadowed_folders(["tosca[noise=1]"], None)
    assert "pass ./tosca" in told


def test_the_report_that_a_run_recommends_is_one_of_its_jobs(tmp_path, in_this_process):
    results = tmp_path / "results"
    rods = write_rods(tmp_path / "rods")
    selection = ("-d", rods, "-m", "identity", "--input", "mesh", "--results", results)
    own = ("--scorer", "distance-distribution", "--plugin", EXAMPLE_SCORER)
    said = call("run", *selection, *own, "--seed", 3, "-j", 0)
    command = shlex.split(said.strip().splitlines()[-1])
    assert command[:4] == ["python", "-m", "benchmark", "report"]
    table = call("tables", *command[4:])  # it selects as the report does, in less time
    assert "Identity" in table
    assert "not shown" not in table


def test_forget_says_what_goes(tmp_path, in_this_process):
    results = tmp_path / "results"
    selection = (
        "-d",
        write_rods(tmp_path / "rods"),
        "-m",
        "shape-dna",
        "-m",
        "surface-area",
        "--results",
        results,
    )
    call("run", *selection, "-j", 0)
    words = ("forget", "-m", "shape-dna", "--results", results)
    assert re.match(r"this deletes 2 records, 12 forms, 0\.\d MB; pass --yes", refusal(*words))
    assert (
        call("forget", "--unused", "--yes", "--results", results)
        == "deleted 0 records, 0 forms, 0.0 MB\n"
    )
    assert "finished  rods mesh shape-dna" in call("plan", *selection)
    lines = call(*words, "--yes").splitlines()
    assert [line.partition("  ")[0] for line in lines[:2]] == [
        "rods mesh shape-dna",
        "rods view shape-dna",
    ]
    assert lines[2].startswith("deleted 2 records, 12 forms")
    states = call("plan", *selection)
    assert "missing   rods mesh shape-dna" in states
    assert "finished  rods mesh surface-area" in states
    call("forget", "-m", "all", "--yes", "--results", results)
    assert not [path for path in (results / "runs").rglob("*.*") if path.is_file()]


def test_the_overview_of_a_plan_gives_a_reason_for_each_job_that_is_not_possible(tmp_path):
    said = call("plan", "-d", "animals", "--input", "view", "--results", tmp_path / "none")
    counts = re.findall(r"^animals(?: held out)? +view +\d+ +(\d+)$", said, re.MULTILINE)
    explained = re.findall(r"^unsupported: [\w, -]+ \((\d+) jobs?\): ", said, re.MULTILINE)
    assert sum(map(int, counts)) == sum(map(int, explained)) > 0


def test_a_plan_names_the_draws_of_a_stand_in_together(tmp_path):
    of_people = ("-d", "people[draw=0]", "-m", "gps", "--input", "mesh")
    said = call("plan", *of_people, "--results", tmp_path / "none")
    (line,) = [line for line in said.splitlines() if "generated stand-in for" in line]
    draws = [f"people[draw={number}]" for number in range(3)]
    assert line.startswith(f"{', '.join(draws)}: generated stand-in for shrec14-synthetic")


def test_the_time_of_a_plan_holds_on_the_machine_whose_records_it_uses(rods, tmp_path):
    selected = ("-d", rods, "--input", "mesh", "--results", tmp_path)
    condition = "if this machine is as fast as that of the published records"
    assert condition in call("plan", *selected, "-m", "gps")
    with without_processes():
        call("run", *selected, "-m", "identity", "-j", 0)
    assert condition in call("plan", *selected, "-m", "gps", "-m", "identity", "--seed", 1)
    said = call("plan", *selected, "-m", "identity", "--seed", 1)
    assert "at most about" in said
    assert condition not in said

"""Whatever a plugin or an argument does, a verb ends with one line and an exit code that says so."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.cli.main import main
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.store import Store
from benchmark.plugins import remote
from tests.plugins.written import ACTS, write_plugin
from tests.processes import is_alive, wait_until
from tests.records import record
from tests.toy import rod, write_off

pytestmark = pytest.mark.usefixtures("forked_workers")

ROOT = Path(__file__).parents[2]


@pytest.fixture
def call(monkeypatch, capfd, tmp_path):
    """Run the command line in this process; returns exit code, output, and what was said on stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CANONICAL_FORMS_DATA", raising=False)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["benchmark", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        captured = capfd.readouterr()
        return code, captured.out, captured.err

    return run


def refused(done):
    """The one line by which a verb refuses."""
    code, _, error = done
    assert code == 2
    (line,) = error.splitlines()
    assert line.startswith("error: ")
    return line


# Arguments -----------------------------------------------------------------------------------------------------------

LONG = "x" * 5000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("new", "method"), "Missing argument 'NAME'; see 'benchmark new --help'"),
        (("run", "--all", "--results", LONG), "File name too long"),
        (("data", "check", LONG), "File name too long"),
        (("canonicalise", "-m", "identity", "a.off", "-o", LONG), "a.off is not a file"),
        (("list", "datasets", "--data-root", "no-such"), "data root no-such is not a readable folder"),
        (("new", "method", "x" * 300), "cannot be the name of a method; use 60 characters at most"),
        (("plan", "-m", "non-metric-mds[rtol=nan]"), "'nan' does not fit rtol of non-metric-mds"),
        (("plan", "-m", "non-metric-mds[max_iterations=-1]"), "'-1' does not fit max_iterations of non-metric-mds"),
        (("report", "--figure", "a.png", "--of", "all"), "see 'benchmark report --help'"),
        (("check", "all"), "unknown method 'all'"),
        (("canonicalise", "-m", "all", "a.off", "-o", "b.off"), "unknown method 'all'"),
    ],
)
def test_an_argument_that_cannot_be_is_refused_in_one_line(call, arguments, message, tmp_path):
    assert message in refused(call(*arguments))
    assert {path.name for path in tmp_path.iterdir()} <= {"results"}


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1", "x"])
def test_no_method_takes_a_number_that_makes_no_sense(value):
    from benchmark.plugins.registry import BUILT_IN, methods, variant

    known = methods()
    tried = 0
    for name in BUILT_IN:
        for parameter, usual in known[name].all_parameters.items():
            if isinstance(usual, int | float) and not isinstance(usual, bool):
                tried += 1
                with pytest.raises(ConfigurationError, match=f"does not fit {parameter} of {name}"):
                    variant(f"{name}[{parameter}={value}]", known)
    assert tried > 20


LEARNER = """

from pathlib import Path
Tried.split = "table"
Tried.shipped_models = Path("none")
Tried.model_name = "tried"
Tried.load = lambda self, folder: self


def train(self, data, folder, options, say):
    say("begun")
    {act}


Tried.train = train
"""


# Plugins that cannot be loaded ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verb", "fault", "message"),
    [
        (("plan",), "exits", "ended its process (exit code 0)"),
        (("list", "methods"), "hangs", "does not end: stopped after 1 s"),
    ],
)
def test_a_plugin_that_cannot_be_imported_is_one_line(call, verb, fault, message, tmp_path, monkeypatch):
    monkeypatch.setattr(remote, "LIMIT", 1.0)
    assert message in refused(call(*verb, "--plugin", write_plugin(tmp_path / "tried.py", on_import=fault)))


def test_nothing_that_a_plugin_leaves_behind_on_import_outlives_or_holds_the_program(tmp_path):
    lines = (
        f"open({str(tmp_path / 'children')!r}, 'a').write("
        "str(subprocess.Popen(['sleep', '600'], start_new_session=True).pid) + ' ')",
        "threading.Thread(target=time.sleep, args=(600,)).start()",
        "atexit.register(time.sleep, 600)",
    )
    plugin = write_plugin(tmp_path / "tried.py", on_import="import atexit, subprocess\n" + "\n".join(lines))
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", "list", "methods", "--plugin", plugin],
        capture_output=True, text=True, check=False, timeout=60, cwd=ROOT,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1].split()[0] == "tried"
    children = [int(word) for word in (tmp_path / "children").read_text().split()]
    assert len(children) == 1  # when it was looked at from outside: the program itself imports no plugin
    wait_until(lambda: not any(map(is_alive, children)))


# Plugins at work -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("act", "message"),
    [
        ("crashes", "ended its process (SIGSEGV)"),
        ("hangs", "does not end: stopped after 1 s"),
        ("sys-exits", "raises SystemExit: 0"),
        ("refuses", "error: too thin; feed it"),
    ],
)
def test_canonicalise_survives_its_method(call, act, message, tmp_path):
    write_off(tmp_path / "data" / "rod.off", rod(0.1, 1.0))
    plugin = write_plugin(tmp_path / "tried.py", at_work=act)
    limit = ("--timeout", "1s") if act == "hangs" else ()
    done = call("canonicalise", "-m", "tried", "data/rod.off", "--plugin", plugin, *limit)
    assert message in refused(done)
    assert not Path("rod-tried.off").exists()


FORKED = """
import os
from pathlib import Path
from benchmark.api.contracts import Shape
from benchmark.plugins.output_checks import form_of
from benchmark.plugins.registry import plugin_methods
from tests.toy import rod

(spec,) = plugin_methods(Path("{plugin}"))
method = spec.create()
form_of(method, Shape(identifier="rod", mesh=rod(0.1, 1.0)))
os.write(1, b"I go on.")
"""


@pytest.mark.parametrize("place", ["on_import", "on_making", "at_work"])
def test_a_copy_of_the_process_that_a_method_makes_and_forgets_does_not_go_on(place, tmp_path):
    plugin = write_plugin(tmp_path / "forks.py", **{place: "os.fork()"})
    code = FORKED.format(plugin=plugin)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "I go on.", "")


def test_the_file_of_a_form_has_a_name_that_fits(call, tmp_path):
    write_off(tmp_path / "data" / "rod.off", rod(0.1, 1.0))
    plugin = write_plugin(tmp_path / "tried.py", name="tried-path", field="start: str = ''")
    code, output, error = call("canonicalise", "-m", "tried-path[start=a/b]", "data/rod.off", "--plugin", plugin)
    assert (code, error) == (0, "")
    assert output.startswith("rod-tried-path[start=a_b].off: 290 vertices")


def test_check_fails_the_check_in_which_a_method_ends_its_process_and_goes_on_with_the_next(call, tmp_path):
    plugin = tmp_path / "acts.py"
    methods = "".join(
        f"@canonical_form(name='{name}', title='T')\ndef act_{number}(shape):\n    {ACTS[name]}\n"
        for number, name in enumerate(("sys-exits", "crashes", "interrupts"))
    )
    plugin.write_text(f"import os, signal, sys\nfrom benchmark.api.contracts import canonical_form\n{methods}")
    code, output, error = call("check", plugin)
    failed = [line.split(maxsplit=3) for line in output.splitlines() if "  failed  " in line]
    assert (code, error) == (1, "")
    assert [words[:3] for words in failed] == [
        ["sys-exits", "failed", "answer"], ["crashes", "failed", "answer"], ["interrupts", "failed", "answer"],
    ]  # fmt: skip
    assert failed[0][3].startswith("raises SystemExit: 0")
    assert "ended its process (SIGSEGV)" in failed[1][3]
    assert failed[2][3].startswith("raises KeyboardInterrupt")


@pytest.mark.parametrize("names", [("crashes",), pytest.param(("hangs", "raises"), marks=pytest.mark.slow)])
def test_a_figure_draws_what_can_be_drawn(call, rods, names, tmp_path):
    """Of methods that break, and have titles that are no formula."""
    plugin = tmp_path / "acts.py"
    methods = "".join(
        f"@canonical_form(name='{name}', title='Cost $ x_{{')\ndef act_{number}(shape):\n    {ACTS[name]}\n"
        for number, name in enumerate(names)
    )
    plugin.write_text(f"import os, signal, time\nfrom benchmark.api.contracts import canonical_form\n{methods}")
    store = Store.open(tmp_path / "results")
    store.write_record(record(method="surface-area", data={"source": str(rods)}))
    selection = ("-d", rods, "--input", "mesh", "-m", "surface-area", "--results", tmp_path / "results")
    named = [word for name in names for word in ("-m", name)]
    figure = tmp_path / "figures" / "forms-rods.png"
    code, _, error = call("report", *selection, *named, "--plugin", plugin, "--figure", figure, "--timeout", "1s")
    assert (code, error) == (0, "")
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_report_runs_no_method(call, rods, tmp_path):
    plugin = write_plugin(tmp_path / "tried.py", at_work="crashes")
    store = Store.open(tmp_path / "results")
    store.write_record(record(method="tried", data={"source": str(rods)}))
    selection = ("-d", rods, "-m", "tried", "--plugin", plugin, "--results", tmp_path / "results")
    code, output, _ = call("report", *selection, "-o", tmp_path / "report")
    assert code == 0
    assert output.rstrip().endswith("0 forms, distances of 0 of 1 jobs")
    assert "python -m benchmark run -d" in (tmp_path / "report" / "table-rods-forms.html").read_text()


@pytest.mark.parametrize(
    ("act", "message"),
    [("exits", "training tried-learner ended its process (exit code 0)"), ("raises", "ZeroDivisionError")],
)
def test_a_training_that_breaks_is_one_line(call, act, message, tmp_path):
    for name, radius in {"cat": 0.08, "dog": 0.1, "horse": 0.2, "wolf": 0.14}.items():
        for number, bend in enumerate((1.0, 2.0)):  # a straight one would be seen end on
            write_off(tmp_path / "data" / "tosca" / f"{name}{number}.off", rod(radius, bend, rings=8, sides=6))
    plugin = write_plugin(tmp_path / f"learner_{act}.py", name="tried-learner")
    plugin.write_text(plugin.read_text() + LEARNER.format(act=ACTS[act]))
    done = call("train", "tried-learner", "-t", "III", "--plugin", plugin, "--data-root", tmp_path / "data")
    assert done[1].splitlines() == ["tried-learner, tosca-III", "begun"]
    assert message in refused(done)

"""Hostile file names and messages through the verbs, from the folder to the terminal and the files."""

import os
from html.parser import HTMLParser

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from tests.toy import RADII, rod, write_off

pytestmark = pytest.mark.usefixtures("forked_workers")

NAMES = {"thin": "=th\udcffin |$_{", "thick": "<b>th\x1b[31mick\n&amp;"}

PLUGIN = """
from benchmark.api.contracts import MethodInfo

class Rude:
    info = MethodInfo(name="rude", title="|Rude_$<b>{", inputs=("mesh",))

    def canonicalise(self, shape):
        raise RuntimeError("\\x1b[2J\\x00no\\n| way " + "x" * 1000)
"""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A results folder in which two methods have done a folder of hostile names, and one has failed."""
    base = tmp_path_factory.mktemp("hostile")
    folder = base / "ro\udcffds `$x_{\n\x1b[31m"
    for kind, name in NAMES.items():
        for number, bend in enumerate((0.0, 1.0)):
            write_off(folder / f"{name}{number}.off", rod(RADII[kind], bend))
    plugin = base / "rude.py"
    plugin.write_text(PLUGIN)
    selection = ("-d", os.fspath(folder), "--input", "mesh", "--results", os.fspath(base / "results"))
    methods = ("-m", "surface-area", "-m", "shape-dna", "-m", "rude", "--plugin", os.fspath(plugin))
    done = call("run", *selection, *methods, "--executor", "serial", code=1)
    return base, selection, methods, done


def call(*arguments, code=0):
    done = CliRunner().invoke(cli, arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.exit_code == code, done.output
    return done


def fit_to_be_shown(text):
    assert [line for line in text.split("\n") if not line.isprintable()] == []
    return text


def test_a_run_of_hostile_names_ends_well_and_prints_nothing_else(hostile):
    _, _, _, done = hostile
    fit_to_be_shown(done.stdout)
    said = fit_to_be_shown(done.stderr)
    assert sum(line.startswith("ok ") for line in said.splitlines()) == 2
    (failed,) = (line for line in said.splitlines() if line.startswith("failed "))
    assert len(failed) < 700
    assert "no | way" in failed


def test_plan_prints_what_can_be_printed(hostile):
    _, selection, methods, _ = hostile
    planned = fit_to_be_shown(call("plan", *selection, *methods).stdout).splitlines()
    assert sorted(line.split()[0] for line in planned) == ["0", "cached", "cached", "failed"]
    told = fit_to_be_shown(call("plan", "--traceback", *selection, *methods).stdout)
    assert "  Traceback (most recent call last):" in told.splitlines()
    assert "    raise RuntimeError(" in told
    assert "x" * 1000 in told


def test_tables_of_hostile_names_are_files_that_can_be_read(hostile, tmp_path):
    base, selection, *_ = hostile
    fit_to_be_shown(call("tables", *selection[-2:], "-o", str(tmp_path)).stdout)
    for path in tmp_path.iterdir():
        fit_to_be_shown(path.read_text(encoding="utf-8"))
    call("tables", *selection[-2:], "-o", str(tmp_path), "--check")
    for kind in ("markdown", "latex", "csv", "json"):
        fit_to_be_shown(call("tables", *selection[-2:], "--format", kind).stdout)
    assert call("merge", os.fspath(base / "results"), "--results", os.fspath(tmp_path / "all")).exit_code == 0
    fit_to_be_shown(call("compare", "surface-area", "shape-dna", *selection[-2:]).stdout)


def test_a_report_of_hostile_names_has_no_element_from_outside(hostile, tmp_path):
    base, _, methods, _ = hostile
    fit_to_be_shown(call("report", "--results", os.fspath(base / "results"), "-o", str(tmp_path), *methods[-2:]).stdout)
    pages = list(tmp_path.glob("*.html"))
    assert len(pages) == 4
    for page in pages:
        reader = Elements()
        reader.feed(fit_to_be_shown(page.read_text(encoding="utf-8")))
        assert all(text.replace(".", "").isdecimal() for text in reader.bold)  # marks of scores, and nothing else
    for script in (tmp_path / "parts" / "data").iterdir():
        assert not set("<>&") & set(script.read_text(encoding="ascii"))


class Elements(HTMLParser):
    """What stands in bold on a page."""

    def __init__(self):
        super().__init__()
        self.bold, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        self.inside = tag == "b"

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        self.bold += [data] if self.inside else []

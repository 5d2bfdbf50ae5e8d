"""A first screen is one, and a stranger's file stays."""

import re

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import BenchmarkError
from tests.test_results import ROOT

pytestmark = pytest.mark.usefixtures("forked_workers")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with published results."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "results").mkdir()
    (folder / "results" / "records").symlink_to(ROOT / "results" / "records")
    return folder


@pytest.fixture
def told(place, monkeypatch):
    """What a command line says."""
    monkeypatch.chdir(place)
    monkeypatch.delenv("CANONICAL_FORMS_DATA", raising=False)

    def call(line):
        done = CliRunner().invoke(cli, line.split())
        return str(done.exception) if isinstance(done.exception, BenchmarkError) else done.output

    return call


@pytest.mark.parametrize(
    ("line", "rest", "most"),
    [
        ("compare classic-mds gps", "45 more pairs differ; --all shows intervals and tests", 24),
    ],
)
def test_a_first_screen_says_how_to_see_the_rest(told, line, rest, most):
    first = told(line)
    assert rest in first.splitlines()[-1]
    assert len(first.splitlines()) <= most
    assert max(map(len, first.splitlines())) <= 130
    whole = told(f"{line} --all")
    assert rest not in whole
    assert len(whole) > 3 * len(first)


def test_what_fits_a_screen_is_told_whole(told):
    chosen = told("compare classic-mds gps -d tosca --input mesh")
    assert chosen.startswith("tosca mesh: 76 of 80 queries changed")
    assert chosen in told("compare classic-mds gps -d tosca --input mesh --all")
    assert "- Mean" not in told("tables -m gps -t III")
    assert "| GPS " in told("tables -m gps -t III")
    pasted = told("tables --published -t III -d tosca --input mesh --format latex")
    assert re.findall(r"\\label\{(.*)\}", pasted) == ["tab:table-III-tosca"]


@pytest.mark.parametrize(
    ("verb", "name", "refused"),
    [
        ("tables", "references.bib", "references.bib was not written by 'tables'; choose another folder with -o"),
        ("report", "index.html", "index.html was not written by 'report'; choose another folder with -o"),
    ],
)
def test_a_strangers_file_stays_unless_it_is_forced_away(told, place, verb, name, refused):
    (place / verb).mkdir()
    (place / verb / name).write_text("mine")
    line = f"{verb} -t III -d tosca -m gps --input mesh -o {verb}"
    assert refused in told(line)
    assert [(path.name, path.read_text()) for path in (place / verb).iterdir()] == [(name, "mine")]
    assert "wrote " in told(f"{line} --force")
    assert (place / verb / name).read_text() != "mine"
    assert "wrote " in told(line)

"""What the README promises is what the project does."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.methods.conformance import check_target
from benchmark.reference import paper
from retrieval.measures import PRINTED
from tests.toy import write_rods

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def python_with(text: str) -> str:
    """The one block of Python with a text in it."""
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if text in block)
    return block


def plugin() -> str:
    return python_with("class Smooth")


@pytest.mark.slow
def test_results_are_read_as_shown(tmp_path, monkeypatch):
    write_rods(tmp_path / "rods")
    run = ["run", "-d", str(tmp_path / "rods"), "-m", "gps", "--input", "mesh", "--executor", "serial"]
    assert CliRunner().invoke(cli, [*run, "--results", str(tmp_path / "results")]).exit_code == 0
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(python_with("open_results").replace("'tosca'", "'rods'"), found)  # noqa: S102
    assert len(found["records"]) == len(found["chosen"]) == 1
    assert {"shape", "subject", "NN", "FT", "ST", "DCG", "E", "mAP"} <= set(found["queries"].columns)
    assert found["distances"].shape == (6, 6)
    assert [form.n_faces > 100 for form in found["forms"].values()] == [True] * 6


def test_the_first_half_of_that_works_with_what_came_with_the_suite(monkeypatch):
    monkeypatch.chdir(ROOT)
    found: dict[str, Any] = {}
    exec(python_with("open_results").partition("\ndistances")[0], found)  # noqa: S102
    assert len(found["queries"]) == 80


def test_the_measures_and_the_paper_are_explained():
    for measure in PRINTED:
        assert f"**{measure}**" in README
    assert "".join(paper.__doc__.split('"')[1].split()) in "".join(README.split())


def test_the_plugin_has_fifteen_lines():
    assert len(plugin().rstrip().splitlines()) == 15


@pytest.mark.slow
def test_the_plugin_keeps_the_contract(tmp_path):
    (tmp_path / "smooth.py").write_text(plugin())
    report = check_target(str(tmp_path / "smooth.py"))
    assert report, f"\n{report}"


@pytest.mark.slow
def test_the_plugin_appears_as_a_row(tmp_path):
    (tmp_path / "smooth.py").write_text(plugin())
    write_rods(tmp_path / "rods")
    command = [
        sys.executable,
        "-m",
        "benchmark",
        "run",
        "-d",
        str(tmp_path / "rods"),
        "-m",
        "identity",
        "--input",
        "mesh",
    ]
    command += ["--plugin", str(tmp_path / "smooth.py"), "--results", str(tmp_path / "results")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert "| Smoothed" in done.stdout


def tables_in(text: str) -> list[str]:
    """All tables of a Markdown text with scores or counts in them: a head, a rule, rows."""
    return [block for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE) if re.search(r"\| *[\d.]+ *\|", block)]


@pytest.mark.parametrize("name", ["README.md", "docs/reproduction.md"])
def test_the_tables_are_those_of_the_results_folder(name):
    shown = tables_in((ROOT / name).read_text(encoding="utf-8"))
    assert shown
    committed = [path.read_text(encoding="utf-8") for path in (ROOT / "results" / "tables").glob("*.md")]
    for table in shown:
        assert any(table in text for text in committed), table


def test_every_file_that_is_linked_exists():
    for text in [README, *((path.read_text(encoding="utf-8")) for path in (ROOT / "docs").glob("*.md"))]:
        for target in re.findall(r"\]\(([^)#]+)\)", text):
            if "://" not in target:
                assert (ROOT / target).exists() or (ROOT / "docs" / target).exists(), target


def test_every_make_target_and_verb_exists():
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^    make (\w+)", README, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
    from benchmark.cli.main import cli

    verbs = re.findall(r"python -m benchmark (\w+)", README)
    assert verbs
    assert set(verbs) <= set(cli.commands)

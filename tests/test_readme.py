"""What the README promises is what the project does."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.toy import write_rods

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def plugin() -> str:
    return re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]


def test_the_plugin_has_fifteen_lines():
    assert len(plugin().rstrip().splitlines()) == 15


@pytest.mark.slow
def test_the_plugin_appears_as_a_row(tmp_path):
    (tmp_path / "flatten.py").write_text(plugin())
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
    command += ["--plugin", str(tmp_path / "flatten.py"), "--results", str(tmp_path / "results")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert "| Flattened" in done.stdout


def test_the_tables_are_those_of_the_results_folder():
    tables = re.findall(r"\*\*Table .*?\n\n(?:\|.*\n)+", README)
    assert tables
    committed = [path.read_text(encoding="utf-8") for path in (ROOT / "results" / "tables").glob("*.md")]
    for table in tables:
        assert any(table.strip() in text for text in committed)


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

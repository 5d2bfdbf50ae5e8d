"""The commands of the pages to start from run as they stand, one after the other, and say what the
pages show.
"""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pytest

from tests.pages.blocks import blocks_of, commands_of
from tests.toy import rod, write_off, write_rods
from tests.verbs import call

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PROGRAM = "python -m benchmark "
#: Runs start no processes, which would import everything anew; commands of README do.
pytestmark = pytest.mark.usefixtures("in_this_process")


def walked(folder: Path, page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the commands of a page in a folder, and look for what its blocks of text show."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("CANONICAL_FORMS_DATA", str(folder / "data"))
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    commands = [line for line in commands_of(text) if line.startswith(PROGRAM)]
    assert commands
    printed = [call(*shlex.split(line.removeprefix(PROGRAM), comments=True)) for line in commands]
    said = " ".join(" ".join(printed).split())
    shown = [
        " ".join(line.split()) for block in blocks_of(text, "text") for line in block.splitlines()
    ]
    # "..." stands for lines that the page leaves out.
    assert [line for line in shown if line != "..." and line not in said] == []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder to start in, and another with a small TOSCA."""
    bends = (0.0, 0.8, 1.6, 2.4)  # of which a quick run takes three
    write_rods(tmp_path / "data" / "tosca", bends, radii={"cat": 0.06, "dog": 0.18})
    return tmp_path


@pytest.mark.slow
def test_your_method_in_the_papers_tables(folder: Path, monkeypatch) -> None:
    write_off(folder / "cat1.off", rod(0.06, 1.2))
    shutil.copy(ROOT / "examples" / "ray_stretch.py", folder)
    walked(folder, "start/first-method", monkeypatch)
    assert (folder / "form.off").is_file()
    assert (folder / "report" / "index.html").is_file()


@pytest.mark.slow
def test_your_own_meshes_and_depth_images(tmp_path: Path, monkeypatch) -> None:
    write_rods(tmp_path / "meshes")
    (tmp_path / "data").mkdir()
    shutil.copytree(ROOT / "examples" / "depth", tmp_path / "examples" / "depth")
    walked(tmp_path, "start/own-data", monkeypatch)
    assert (tmp_path / "report" / "index.html").is_file()
    assert (
        len(list((tmp_path / "forms").rglob("*.*")))
        == len(list((tmp_path / "pictures").rglob("*.png")))
        == 8
    )
    assert (tmp_path / "found.png").is_file()

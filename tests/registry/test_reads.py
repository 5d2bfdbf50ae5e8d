"""Files that a plugin reads without declaring them are named; what no result depends on is not."""

from __future__ import annotations

import json
import py_compile
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmark import reads
from benchmark.code_digest import ROOT
from benchmark.registry.known import in_file
from tests.runs.toy import planned, run_toy

PROGRAM = """
import importlib, json, os, sys
from pathlib import Path
from benchmark.errors import BenchmarkError
from benchmark.registry.known import in_file
from benchmark.reads import watch_this_process
from benchmark.registry.components import watching_component
from benchmark.api import Shape
from benchmark.check.shapes import figure
shape = Shape(identifier='figure', mesh=figure())
watch_this_process()
outcomes = {}
for file in map(Path, sys.argv[1:]):
    os.chdir(file.parent)
    try:
        for component in in_file(file):
            method = component.create()
            with watching_component(component):
                method.canonicalise(shape)
        outcomes[file.parent.name] = "ok"
    except BenchmarkError as error:
        outcomes[file.parent.name] = str(error)
print(json.dumps(outcomes))
"""

PLUGIN = """
import numpy as np
from benchmark.api import canonical_form
{before}


@canonical_form(name="{name}", title="A", files={files})
def method(shape):
    {within}
    return shape.mesh.vertices
"""

#: By name, what a plugin does when it is imported, and at a shape; what it reads lies beside it.
UNDECLARED, FAULTLESS = (
    {
        name: cell
        for name, *cell in (
            re.split(r" \| ?", line.replace("\\n", "\n")) for line in part.splitlines()[1:]
        )
    }
    for part in Path(__file__).with_name("reads.txt").read_text().split("## ")[1:]
)


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, str]:
    """What became of all plugins in one process that watches them."""
    folder = tmp_path_factory.mktemp("plugins")
    for name, (before, within) in (UNDECLARED | FAULTLESS).items():
        files = ("declared.txt",) if name == "declared" else ()
        write_material(folder / name)
        text = PLUGIN.format(
            name=name.replace("_", "-"), before=before, within=within or "pass", files=files
        )
        (folder / name / "own.py").write_text(text)
    paths = [str(folder / name / "own.py") for name in UNDECLARED | FAULTLESS]
    command = [sys.executable, "-c", PROGRAM, *paths]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def write_material(folder: Path) -> None:
    folder.mkdir()
    for name in ("value.txt", "declared.txt"):
        (folder / name).write_text("1")
    modules = {
        "unseen": "value",
        "helper": "fine_helper",
        "compiled": "only_compiled",
    }  # one process finds all folders
    for name in (modules.get(folder.name, "text"), "program"):
        (folder / f"{name}.py").write_text("VALUE = 1\n")
    (folder / "lib").mkdir()
    for name in ("in_lib", "in_path"):
        (folder / "lib" / f"{name}.py").write_text("VALUE = 1\n")
    np.save(folder / "value.npy", np.zeros(2))
    (folder / "library.so").write_bytes(b"\x7fELF")
    if folder.name == "linked":
        (folder / "linked.py").symlink_to("program.py")
    if folder.name == "of_helper":
        (folder / "helper.py").write_text("TEXT = open(__file__[:-9] + 'value.txt').read()\n")
    if folder.name == "compiled":
        py_compile.compile(
            str(folder / "only_compiled.py"), cfile=str(folder / "only_compiled.pyc")
        )
        (folder / "only_compiled.py").unlink()
    with zipfile.ZipFile(folder / "value.zip", "w") as archive:
        archive.writestr("in_zip.py", "VALUE = 1\n")


@pytest.mark.slow
@pytest.mark.parametrize("name", UNDECLARED)
def test_what_a_plugin_reads_without_declaring_it_is_named_with_the_remedy(outcomes, name):
    assert f"{name}/own.py" in outcomes[name], outcomes[name]
    assert "in a way that its code does not show" in outcomes[name], outcomes[name]
    assert "declare it in info: files=(" in outcomes[name], outcomes[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTLESS)
def test_no_alarm(outcomes, name):
    assert outcomes[name] == "ok"


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("system/src/value.txt", True),
        ("system/src/data/value.txt", True),
        ("system/src/environment/value.txt", False),
        ("system/lib/value.txt", False),
    ],
)
def test_files_beside_a_plugin_in_a_folder_of_the_system_count(tmp_path, monkeypatch, file, counts):
    places = (str(tmp_path / "system"), str(tmp_path / "system" / "src" / "environment"))
    monkeypatch.setattr(reads, "_EXEMPT", places)
    folder = tmp_path / "system" / "src"
    assert reads._is_of_user(tmp_path / file, folder, [], is_program=False) == counts


def test_a_job_that_reads_an_undeclared_file_of_its_results_folder_fails_and_leaves_no_form(
    rods, tmp_path
):
    text = PLUGIN.format(name="reading", before="", within="open(__file__[:-3])", files=())
    (tmp_path / "reading.py").write_text(text)
    (tmp_path / "reading").write_text("1")
    plugins = (tmp_path / "reading.py",)
    (record,) = run_toy(rods, tmp_path, "reading", plugins=plugins, size=1).values()
    assert (record.status, "declare it in info: files=('reading',)" in record.reason) == (
        "failed",
        True,
    )
    forms = {
        view.keys["forms"]
        for view in planned(rods, tmp_path, "reading", plugins=plugins)[0].record.views_of_shapes
    }
    assert not any((tmp_path / "runs" / "forms" / f"{key}.npz").exists() for key in forms)


def test_a_file_that_one_method_names_is_code_of_all_methods_of_a_plugin(tmp_path):
    text = PLUGIN.format(
        name="one", before="VALUE = open(__file__[:-6] + 'value.txt').read()", within="", files=()
    )
    text += (
        text[text.index("@") :]
        .replace("method", "other")
        .replace('"one"', '"two"')
        .replace("()", "('value.txt',)")
    )
    (tmp_path / "own.py").write_text(text)
    keys = set()
    for value in "12":
        (tmp_path / "value.txt").write_text(value)
        keys.add(in_file(tmp_path / "own.py")[0].key()["code"])
    assert len(keys) == 2

"""Files that a plugin reads without declaring them are named; what no result depends on is not."""

from __future__ import annotations

import json
import py_compile
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmark.code_digest import ROOT
from benchmark.registry.known import in_file
from tests.runs.toy import planned, run_toy

PROGRAM = """
import importlib, json, os, sys
from pathlib import Path
from benchmark.errors import BenchmarkError
from benchmark.registry.known import in_file
from benchmark.reads import watch_this_process, watching
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
            with watching(component.target, [file.parent / name for name in component.info.files]):
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

#: What a plugin does when it is imported, and at a shape; what it reads lies beside it.
UNDECLARED = {
    "opened": ("", "open('value.txt').read()"),
    "by_path": ("from pathlib import Path", "Path(__file__).with_name('value.txt').read_text()"),
    "at_import": ("TABLE = np.load('value.npy')", ""),
    "mapped": ("", "np.load('value.npy', mmap_mode='r')"),
    "descriptor": ("import os", "os.read(os.open('value.txt', os.O_RDONLY), 9)"),
    "executed": ("", "exec(open('text.py').read())"),
    "run": ("import runpy", "runpy.run_path('text.py')"),
    "unseen": ("", "__import__('value')"),
    "compiled": ("import importlib", "importlib.import_module('only_' + 'compiled')"),
    "zipped": ("import sys; sys.path.insert(0, __file__[:-6] + 'value.zip')", "__import__('in_zip')"),
    "program": ("import subprocess, sys", "subprocess.run([sys.executable, 'program.py'], check=True)"),
    "shell": ("import os, sys", "os.system(f'{sys.executable} program.py')"),
    "word": ("import subprocess", "subprocess.run(['wc', 'value.txt'], capture_output=True)"),
    "words": ("import subprocess", "subprocess.run('true|dd if=\"value.txt\"', shell=True, capture_output=True)"),
    "updated": ("import os", "os.read(os.open('value.txt', os.O_RDWR | os.O_CREAT), 9)"),
    "database": ("import sqlite3", "sqlite3.connect('value.txt')"),
    "forked": ("import multiprocessing", "multiprocessing.get_context('fork').Pool(1).map(np.load, ['value.npy'])"),
    "library": ("import ctypes", "\n    try: ctypes.CDLL('./library.so')\n    except OSError: pass"),
    "of_helper": ("import helper", ""),
    "caught": ("", "\n    try: raise OSError\n    except OSError: open('value.txt').close()"),
}

FAULTLESS = {
    "declared": ("", "open('declared.txt').read()"),
    "helper": ("import fine_helper", "fine_helper.VALUE"),
    "linked": ("import linked", "linked.VALUE"),
    "numba": ("from numba import njit\n@njit(cache=True)\ndef f(x): return x + 1", "f(1)"),
    "scipy": ("import scipy.sparse.linalg, scipy.spatial", "scipy.spatial.cKDTree(shape.mesh.vertices)"),
    "sklearn": ("", "import sklearn.manifold; sklearn.manifold.MDS"),
    "torch": ("", "import torch; torch.nn.Linear(2, 2)(torch.zeros(2))"),
    "matplotlib": ("", "import matplotlib.pyplot as plt; plt.figure().text(0, 0, 'a')"),
    "trimesh": ("", "import trimesh; trimesh.creation.box().export(file_type='off')"),
    "potpourri": ("", "import potpourri3d"),
    "pymeshlab": ("", "import pymeshlab; pymeshlab.MeshSet()"),
    "igl": ("", "import igl; igl.cotmatrix(shape.mesh.vertices, shape.mesh.faces)"),
    "pandas": ("", "import pandas, io; pandas.read_csv(io.StringIO('a'))"),
    "logger": ("import logging", "logging.basicConfig(filename='log.txt'); logging.warning('a')"),
    "temporary": ("import tempfile", "f = tempfile.TemporaryFile(); f.write(b'a'); f.seek(0); f.read()"),
    "named": ("import tempfile", "n = tempfile.NamedTemporaryFile(suffix='.off'); open(n.name).read()"),
    "built": ("import os, sys", "open('mine.py', 'w').close(); os.system(f'{sys.executable} mine.py')"),
    "written": ("", "np.save('mine.npy', shape.mesh.vertices); np.load('mine.npy')"),
    "appended": ("", "open('value.txt', 'a').close()"),
    "processor": ("import platform", "platform.processor(), platform.platform()"),
    "find_library": ("import ctypes.util", "ctypes.util.find_library('m')"),
    "of_system": ("import ctypes", "ctypes.CDLL('libm.so.6')"),
    "a_program": ("import subprocess", "subprocess.run(['true'], check=True)"),
    "time_zone": ("import datetime, zoneinfo", "datetime.datetime.now(zoneinfo.ZoneInfo('UTC'))"),
    "resources": ("import importlib.metadata", "importlib.metadata.version('numpy')"),
    "suite": ("from baselines.gps import GPS", "GPS().canonicalise(shape)"),
    "fork": ("import multiprocessing", "multiprocessing.get_context('fork').Pool(1).map(abs, [1])"),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, str]:
    """What became of all plugins in one process that watches them."""
    folder = tmp_path_factory.mktemp("plugins")
    for name, (before, within) in (UNDECLARED | FAULTLESS).items():
        files = ("declared.txt",) if name == "declared" else ()
        write_material(folder / name)
        text = PLUGIN.format(name=name.replace("_", "-"), before=before, within=within or "pass", files=files)
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
    modules = {"unseen": "value", "helper": "fine_helper", "compiled": "only_compiled"}  # one process finds all folders
    for name in (modules.get(folder.name, "text"), "program"):
        (folder / f"{name}.py").write_text("VALUE = 1\n")
    np.save(folder / "value.npy", np.zeros(2))
    (folder / "library.so").write_bytes(b"\x7fELF")
    if folder.name == "linked":
        (folder / "linked.py").symlink_to("program.py")
    if folder.name == "of_helper":
        (folder / "helper.py").write_text("TEXT = open(__file__[:-9] + 'value.txt').read()\n")
    if folder.name == "compiled":
        py_compile.compile(str(folder / "only_compiled.py"), cfile=str(folder / "only_compiled.pyc"))
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


def test_a_job_that_reads_an_undeclared_file_of_its_results_folder_fails_and_leaves_no_form(rods, tmp_path):
    text = PLUGIN.format(name="reading", before="", within="open(__file__[:-3])", files=())
    (tmp_path / "reading.py").write_text(text)
    (tmp_path / "reading").write_text("1")
    plugins = (tmp_path / "reading.py",)
    (record,) = run_toy(rods, tmp_path, "reading", plugins=plugins, size=1).values()
    assert (record.status, "declare it in info: files=('reading',)" in record.reason) == ("failed", True)
    forms = {keys["forms"] for keys in planned(rods, tmp_path, "reading", plugins=plugins)[0].record.keys}
    assert not any((tmp_path / "runs" / "forms" / f"{key}.npz").exists() for key in forms)


def test_a_file_that_one_method_names_is_code_of_all_methods_of_a_plugin(tmp_path):
    text = PLUGIN.format(name="one", before="VALUE = open(__file__[:-6] + 'value.txt').read()", within="", files=())
    text += text[text.index("@") :].replace("method", "other").replace('"one"', '"two"').replace("()", "('value.txt',)")
    (tmp_path / "own.py").write_text(text)
    keys = set()
    for value in "12":
        (tmp_path / "value.txt").write_text(value)
        keys.add(in_file(tmp_path / "own.py")[0].key()["code"])
    assert len(keys) == 2

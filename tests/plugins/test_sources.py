"""What a row of a plugin hangs on: its file, what it imports or loads from wherever, and the files that it reads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.execution.processes.opened_files import NOT_OF_PLUGINS
from benchmark.execution.processes.process import Process
from benchmark.plugins.modules import import_module, sources_of
from benchmark.source_code import ROOT
from tests.toy import write_rods

PLUGIN = """
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import elsewhere
from benchmark.api import CanonicalForm, MethodInfo, Shape

HERE = Path(__file__).parent

@dataclass(frozen=True, kw_only=True)
class Stretched:
    "Stretch by what files say."

    info: ClassVar[MethodInfo] = MethodInfo(name="stretched", title="Stretched", files=("program.sh",))

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        spec = importlib.util.spec_from_file_location("loaded", HERE / "data" / "loaded.py")
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        factor = float((HERE / "data" / "factor.csv").read_text())
        return shape.form(shape.mesh.vertices * [1, factor * loaded.FACTOR, elsewhere.FACTOR])
"""


@pytest.fixture
def call(tmp_path):
    """Call the program as an author does, with a folder of modules of one's own."""
    write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    files = {
        "plugin/stretched.py": PLUGIN,
        "plugin/program.sh": "echo 1\n",
        "plugin/data/loaded.py": "FACTOR = 1.0\n",
        "plugin/data/factor.csv": "1.0\n",
        "lib/elsewhere.py": "FACTOR = 1.0\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)

    def call(verb):
        words = ["-d", "rods", "-m", "stretched", "-m", "identity", "--input", "mesh", "--results", "results"]
        done = subprocess.run(
            [sys.executable, "-m", "benchmark", verb, *words, "--plugin", "plugin/stretched.py"],
            cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(tmp_path / "lib")}, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return {line.split()[3]: line for line in done.stdout.splitlines() if line.startswith(("cached", "stale"))}

    return call


@pytest.mark.slow
def test_a_row_is_run_again_when_anything_changes_that_its_plugin_works_by(call, tmp_path):
    call("run")
    plan = call("plan")
    assert {name: line.split()[0] for name, line in plan.items()} == {"stretched": "cached", "identity": "cached"}
    edits = {
        "plugin/stretched.py": (PLUGIN.replace("[1,", "[2,"), "stretched.py"),
        "plugin/program.sh": ("echo 2\n", "program.sh"),
        "plugin/data/loaded.py": ("FACTOR = 2.0\n", "loaded.py"),
        "plugin/data/factor.csv": ("2.0\n", "factor.csv"),
        "lib/elsewhere.py": ("FACTOR = 2.0\n", "elsewhere.py"),
    }
    for name, (text, said) in edits.items():
        before = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text)
        plan = call("plan")
        assert plan["stretched"].startswith("stale"), name
        assert f"{said}" in plan["stretched"]
        assert plan["identity"].startswith("cached")
        (tmp_path / name).write_text(before)
        assert call("plan")["stretched"].startswith("cached"), name
    before = forms(tmp_path)
    (tmp_path / "plugin/data/factor.csv").write_text("3.0\n")
    call("run")
    assert call("plan")["stretched"].startswith("cached")
    after = forms(tmp_path)
    assert before["stretched"] != after["stretched"]
    assert before["identity"] == after["identity"]


def forms(folder):
    """Digests of the forms by method."""
    records = map(json.loads, (path.read_text() for path in (folder / "results/runs/records").glob("*.json")))
    return {record["method"]: record["digests"]["forms"] for record in records}


def imports_and_reads(facts, arrays, tell):
    """Import a plugin as its process does, and read a file."""
    import_module(facts["plugin"])
    sources_of(facts["plugin"])
    return {"text": Path(facts["data"]).read_text()}, {}


def test_a_plugin_counts_by_its_code_wherever_it_lies_and_other_files_by_their_place(tmp_path):
    plugin, data = tmp_path / "plain.py", tmp_path / "data.csv"
    plugin.write_text("import helper\n")
    (tmp_path / "helper.py").write_text("FACTOR = 1.0\n")
    data.write_text("1.0\n")
    process = Process(imports_and_reads, is_plugin=True)
    try:
        process.request({"plugin": str(plugin), "data": str(data)})
        assert [path for path in process.files if Path(path).parent == tmp_path] == [str(data)]
    finally:
        process.end()


def test_a_file_whose_name_begins_like_a_package_of_the_suite_is_none_of_it():
    assert (ROOT / "learned" / "mine.py").as_posix().startswith(NOT_OF_PLUGINS)
    assert not (ROOT / "learned_mine.py").as_posix().startswith(NOT_OF_PLUGINS)

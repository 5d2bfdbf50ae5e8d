"""Modules of plugins that lie elsewhere: a worker finds what the program has found."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmark.runs.tasks import Outcome, Task
from benchmark.runs.workers import Worker
from tests.runs.toy import planned, run_toy

#: A method whose figures depend on a module in another folder than its own.
PLUGIN = """
import sys
from pathlib import Path

from benchmark.api import canonical_form

{before}
import {module}


@canonical_form(name="elsewhere", title="Elsewhere")
def elsewhere(shape):
    return shape.mesh.vertices * {module}.FACTORS
"""

ADDS_ITS_FOLDER = "sys.path.insert(0, str(Path(__file__).parent / '..' / 'library'))"


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))


def write(folder: Path, module: str, before: str) -> Path:
    """Write a plugin and the module that it imports; return the file of the plugin."""
    (folder / "library").mkdir()
    (folder / "library" / f"{module}.py").write_text("FACTORS = [1, 1, 0.5]\n")
    (folder / "plugins").mkdir()
    path = folder / "plugins" / "own.py"
    path.write_text(PLUGIN.format(before=before, module=module))
    return path


def test_a_plugin_may_add_a_folder_to_the_path_of_modules(rods, tmp_path):
    plugin = write(tmp_path, "added_by_plugin", ADDS_ITS_FOLDER)
    (record,) = run_toy(rods, tmp_path, "elsewhere", plugins=(plugin,), size=1).values()
    assert record.status == "ok", record.reason
    assert "added_by_plugin.py" in record.parts


def test_a_worker_finds_modules_on_the_path_of_the_program(rods, tmp_path):
    sys.path.append(str(tmp_path / "library"))
    plugin = write(tmp_path, "added_by_program", "")
    (record,) = run_toy(rods, tmp_path, "elsewhere", plugins=(plugin,), size=1).values()
    assert record.status == "ok", record.reason
    assert "added_by_program.py" in record.parts


def test_a_process_that_has_not_imported_a_plugin_yet_finds_its_code(rods, tmp_path, monkeypatch):
    plugin = write(tmp_path, "added_late", ADDS_ITS_FOLDER)
    (job,) = planned(rods, tmp_path, "elsewhere", plugins=(plugin,))
    prepared, form, _ = job.steps()[0]
    monkeypatch.setattr(sys, "path", [place for place in sys.path if "library" not in place])
    worker = Worker(2**30, 60.0, 1)
    for step in (prepared, form):  # as on a cluster, whose path is not that of the program
        worker.begin(Task((step,)))
        outcomes: list[Outcome] = []
        while not outcomes:
            outcomes = [outcome for _, outcome in worker.outcomes()]
        assert outcomes[0].status == "ok", outcomes[0].reason
    worker.close()

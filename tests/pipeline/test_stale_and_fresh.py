"""What runs again after a change, and what the plan says of it."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from benchmark import code_digest
from benchmark.pipeline.record_arrays import read_distances, read_form
from benchmark.pipeline.record_files import read_records, write_record
from benchmark.pipeline.records import record_of
from benchmark.runs import tasks
from tests.registry.plugin import write_plugin
from tests.runs.toy import done, planned, run_toy
from tests.toy import write_rods

STRETCHED = """def canonicalise(self, shape):
        return shape.form(shape.mesh.vertices * factor() ** self.power + shape.geodesics()[0, 0])"""
HELPER = """from numba import njit

@njit
def kernel(value):
    return value * 2.0

def factor():
    return kernel(1.0)
"""


class World:
    """A plugin with a helper and a table, and a folder of rods; methods are planned as by a new
    process.
    """

    names = ("stretch", "gps", "identity", "surface-area")

    def __init__(self, folder: Path) -> None:
        self.plugin, self.rods, self.results = (
            folder / "stretch.py",
            folder / "rods",
            folder / "results",
        )

    def write(self) -> None:
        folder = self.plugin.parent
        write_plugin(
            self.plugin,
            imports="from lengthen import factor",
            name="stretch",
            info='files=("table.csv",)',
            fields="power: float = 1.0",
            methods=STRETCHED,
        )
        (folder / "lengthen.py").write_text(HELPER)
        (folder / "table.csv").write_text("1,2\n")
        write_rods(self.rods, bends=(0.0, 1.0))

    def plan(self, *names: str):
        self.forget_code()
        return planned(self.rods, self.results, *(names or self.names), plugins=(self.plugin,))

    def forget_code(self) -> None:
        for name in [
            name for name in sys.modules if name.startswith("plugin_stretch") or name == "lengthen"
        ]:
            del sys.modules[name]
        for module in (code_digest, tasks):
            for value in vars(module).values():
                # Sources are parsed again when their time or size has changed.
                if hasattr(value, "cache_clear") and value is not code_digest._parsed_once:
                    value.cache_clear()

    def stale(self) -> dict[str, str]:
        """Return what would run again, and why."""
        return {
            job.job.method.base_name: job.reason for job in self.plan() if job.state != "finished"
        }


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a world whose methods have run; to be read only."""
    world = World(tmp_path_factory.mktemp("worlds") / "world")
    world.write()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        done(world.plan(), world.results)
    return world.rods.parent


@pytest.fixture
def world(finished, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    world = World(shutil.copytree(finished, tmp_path / "world"))
    for record in (world.results / "runs" / "records").glob(
        "*.json"
    ):  # as if it had always been there
        content = json.loads(record.read_text().replace(str(finished), str(tmp_path / "world"))) | {
            "checksum": ""
        }
        write_record(world.results, record_of(content))
    done(world.plan(), world.results)
    return world


def edit(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.fixture
def edited(monkeypatch):
    """Return a function that makes one file of the suite look edited, in some of its functions."""
    real = code_digest._parsed

    def pretend(name, *functions):

        def parsed(path):
            module = real(path)
            if not str(path).endswith(name):
                return module
            definitions = {**module.definitions, **dict.fromkeys(functions, "e" * 16)}
            return module._replace(digest="e" * 16, definitions=definitions)

        monkeypatch.setattr(code_digest, "_parsed", parsed)

    return pretend


EVERYTHING = {"gps", "identity", "surface-area", "stretch"}
TOUCHED = {
    "baselines/gps.py": {"gps"},
    "geometry/geodesics.py": EVERYTHING,
    "runs/light_scorer.py": EVERYTHING - {"surface-area"},
    "retrieval/measures.py": EVERYTHING,
    "pipeline/ranking.py": EVERYTHING,
    "pipeline/forms.py": EVERYTHING,
    "pipeline/surfaces.py": EVERYTHING,
    "formats/off.py": EVERYTHING,
}
TOUCHES_NOTHING = (
    "baselines/fast_mds.py",
    "benchmark/errors.py",
    "benchmark/text.py",
    "benchmark/files.py",
    "benchmark/code_digest.py",
    "api/__init__.py",
    "api/learning.py",
    "api/parameters.py",
    "formats/obj.py",
    "datasets/mesh_files.py",
    "pipeline/outputs.py",
    "pipeline/prepared.py",
    "pipeline/views.py",
)


def test_an_edit_of_the_suite_runs_what_it_touches(world, edited):
    for name, methods in TOUCHED.items():
        edited(name)
        assert world.stale() == {method: f"{Path(name).name} changed" for method in methods}
    edited(TOUCHES_NOTHING)
    assert world.stale() == {}


def test_the_functions_of_the_suite_that_changed_are_named(world, edited):
    edited("baselines/gps.py", "GPS.canonicalise", "EXTRA")
    assert world.stale() == {"gps": "gps.py (GPS.canonicalise, EXTRA) changed"}
    (world.results / "runs" / "code.json").write_text("damaged")
    assert world.stale() == {"gps": "gps.py changed"}


def test_an_edit_of_a_plugin_or_of_what_it_uses_runs_it_alone(world):
    folder = world.plugin.parent
    for path, old, new in [
        (world.plugin, "* factor()", "/ factor()"),
        (folder / "lengthen.py", "value * 2.0", "value * 3.0"),
        (folder / "table.csv", "1,2", "1,3"),
    ]:
        before = path.read_text()
        edit(path, old, new)
        assert world.stale() == {"stretch": f"{path.name} changed"}
        path.write_text(before)
    assert world.stale() == {}


def test_the_name_of_a_plugin_file_changes_nothing(world):
    world.plugin = world.plugin.rename(world.plugin.with_name("stretch_it.py"))
    assert world.stale() == {}


def test_an_edit_of_ranking_or_of_a_measure_makes_no_form_anew_and_one_of_preparation_does(
    world, edited
):
    made = {"forms", "prepared", "signatures"}
    expected = {
        "pipeline/ranking.py": set(),
        "retrieval/measures.py": set(),
        "pipeline/forms.py": made - {"prepared"},
        "pipeline/surfaces.py": made,
        "formats/off.py": made,
    }
    for name, kinds in expected.items():
        edited(name)
        before = {*(world.results / "runs").glob("*/*.npz")}
        assert done(world.plan("stretch", "gps"), world.results)["gps"].status == "ok"
        after = {*(world.results / "runs").glob("*/*.npz")}
        assert {path.parent.name for path in after - before} == kinds | {"records"}, name


def test_other_data_run_everything_on_the_shapes_that_changed_alone(world):
    edit(world.rods / "thin0.off", "OFF\n", "OFF\n# moved\n")
    assert world.stale() == dict.fromkeys(world.names, "the data changed")
    before = set((world.results / "runs" / "forms").iterdir())
    run_toy(world.rods, world.results, "identity")
    assert len(set((world.results / "runs" / "forms").iterdir()) - before) == 1


def test_the_next_run_of_a_job_replaces_its_record_and_until_then_its_forms_are_there(world):
    edit(world.plugin, "* factor()", "/ factor()")
    (old,) = [record for record in read_records(world.results) if record.method == "stretch"]
    assert read_form(world.results, old, "thin1") is not None
    assert read_distances(world.results, old).shape == (4, 4)
    new = done(world.plan("stretch"), world.results)["stretch"]
    assert [record.key for record in read_records(world.results) if record.method == "stretch"] == [
        new.key
    ]
    assert new.key != old.key

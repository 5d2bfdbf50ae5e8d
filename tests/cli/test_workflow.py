"""From the command line to the records: one method is one job, costs are charged, disk is spared, code is named."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.pipeline.storage.store import Store
from tests.toy import rod, write_off
from tests.verbs import call

ROOT = Path(__file__).parents[2]


def benchmark(*arguments, cwd=ROOT, **options):
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CANONICAL_FORMS_DATA")}
    return subprocess.run(
        [sys.executable, "-m", "benchmark", *map(str, arguments)],
        capture_output=True, text=True, cwd=cwd, timeout=580, check=False, env=clean, **options,
    )  # fmt: skip


def test_ways_to_write_one_method_are_one_job_and_one_row(rods, tmp_path):
    twelve, six = ("shape-dna[count=12]", " shape-dna[ count = 012 ] "), ("shape-dna[count=6]", "shape-dna[count=06]")
    written = ("shape-dna", *twelve, *six)
    arguments = (
        "-d",
        rods,
        "--input",
        "mesh",
        "--results",
        tmp_path,
        *(w for name in written for w in ("-m", name)),
    )
    assert call("plan", *arguments).splitlines()[-1] == "2 of 2 jobs to run"
    text = call("run", *arguments, "-j", "0")
    assert [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| Shape")] == [
        "ShapeDNA ¹", "ShapeDNA (count=6) ¹",
    ]  # fmt: skip
    assert sorted(record["method"] for record in Store.open(tmp_path).records) == ["shape-dna", "shape-dna[count=6]"]
    rows = json.loads(call("tables", *arguments, "--format", "json"))
    assert [row["method"] for row in rows] == ["shape-dna", "shape-dna[count=6]"]


METHODS = ("surface-area", "classic-mds", "fast-mds", "least-squares-mds", "identity")


@pytest.fixture(scope="module")
def large_run(tmp_path_factory):
    """Five methods on shapes of 2000 vertices, like those of TOSCA; the third shape of a process is past first uses."""
    folder = tmp_path_factory.mktemp("large")
    for name, radius in {"cat": 0.08, "dog": 0.15}.items():
        for number, bend in enumerate((0.0, 0.8, 1.6)):
            write_off(folder / "data" / f"{name}{number}.off", rod(radius, bend, rings=110, sides=22))
    arguments = ("-d", folder / "data", "--results", folder / "results", *(w for m in METHODS for w in ("-m", m)))
    done = benchmark("run", *arguments, "-j", 1)
    assert done.returncode == 0, done.stderr
    records = {(record["input"], record["method"]): record for record in Store.open(folder / "results").records}
    assert len(records) == 2 * len(METHODS)
    return folder / "results", records


@pytest.mark.slow
def test_geodesics_are_charged_to_every_method_that_used_them_and_to_no_other(large_run):
    _, records = large_run
    for input_ in ("mesh", "view"):
        seconds = {method: records[input_, method]["cost"]["seconds_per_shape"] for method in METHODS}
        assert seconds["classic-mds"]["geodesics"] == seconds["least-squares-mds"]["geodesics"] > 0
        for method in ("surface-area", "identity", "fast-mds"):  # the last asks for a few rows alone
            assert "geodesics" not in seconds[method]
        assert "features" not in seconds["surface-area"]
        assert all(phases["prepare"] == seconds["identity"]["prepare"] for phases in seconds.values())
        # One process treats the six shapes, or two do; the first shape of each compiles and loads.
        (timed,) = {records[input_, method]["cost"]["shapes_timed"] for method in METHODS}
        assert timed in (4, 5)


@pytest.fixture(scope="module")
def copy_of_the_suite(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy")
    for name in ("benchmark", "baselines", "learned", "retrieval"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.mark.slow
def test_one_character_in_a_reader_of_files_is_named_for_every_file_and_for_nothing_generated(copy_of_the_suite, rods):
    """Records of jobs on files and on generated shapes are made once; then one character of the code changes."""
    suite = copy_of_the_suite
    methods = ("-m", "surface-area", "-m", "identity")
    from_files = ("-d", rods, *methods, "--results", suite / "results")
    generated = ("-d", "animals", "--quick", *methods, "--results", suite / "results")

    def planned(arguments):
        done = benchmark("plan", *arguments, cwd=suite)
        assert done.returncode == 0, done.stderr
        *lines, last = done.stdout.splitlines()
        lines = [line for line in lines if " mesh " in line or " view " in line]  # others estimate time and disk
        return [line.split(maxsplit=1)[0] for line in lines], lines, last

    before = planned(from_files), planned(generated)
    assert [set(states) for states, _, _ in before] == [{"missing"}, {"missing"}]
    _records_without_work(suite, from_files, generated)
    assert [set(planned(arguments)[0]) for arguments in (from_files, generated)] == [{"cached"}, {"cached"}]

    path = suite / "benchmark" / "geometry" / "formats" / "text.py"
    text = path.read_text()

    def edit(old, new):
        changed = text.replace(old, new, 1)
        assert sum(a != b for a, b in zip(text, changed, strict=True)) == 1
        path.write_text(changed)

    edit("and STL", "and STl")  # in the docstring of the module, which changes nothing
    assert set(planned(from_files)[0]) == {"cached"}
    edit(">= 84", ">= 85")
    states, lines, last = planned(from_files)
    assert states == ["stale"] * 4
    assert all(line.endswith("edited: benchmark/geometry/formats; run make golden") for line in lines)
    assert last == "4 of 4 jobs to run"
    states, _, last = planned(generated)
    assert states == ["cached"] * 4
    assert last == "0 of 4 jobs to run"
    path.write_text(text)
    assert set(planned(from_files)[0]) == {"cached"}


def _records_without_work(suite, *selections):
    """Write a record under the key of every job of some selections, in the copy of the suite itself."""
    (suite / "records.py").write_text((ROOT / "tests" / "records.py").read_text())
    program = """
import sys
from benchmark.cli import plan
from benchmark.cli.main import cli
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.store import Store
import records

def write(options):
    store = Store.open(options.results)
    for job in plan.planned_jobs(options, store):
        made = records.record(method=job.method.name, input_=job.input)
        store.write_record({**made, **keys.plain(job.facts), "recipe": keys.plain(job.recipe), "key": job.key})

plan.plan = write
cli(["plan", *sys.argv[1:]])
"""
    for arguments in selections:
        subprocess.run([sys.executable, "-c", program, *map(str, arguments)], cwd=suite, check=True, timeout=280)

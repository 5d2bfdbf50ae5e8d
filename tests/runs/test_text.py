"""Text from outside that is no UTF-8, has control characters or megabytes ends no run, and records
stay valid.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import msgspec
import pytest

from benchmark.api import MethodInfo
from benchmark.api.datasets import Entry
from benchmark.datasets.mesh_files import mesh_file_set
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record, record_of
from tests.registry.plugin import write_plugin
from tests.runs.toy import LIGHT, run_toy
from tests.toy import write_rods
from tests.verbs import call

ODD = "'a\\nb\\x1b[2J \\udcff \\u202e ' + 300_000 * 'x'"


class Silent(Exception):
    def __str__(self):
        raise ValueError


@pytest.mark.slow
def test_text_from_outside_ends_no_run(tmp_path):
    """A run in a folder whose path is no UTF-8, with a dangling link, and of methods that say odd
    things.
    """
    folder = tmp_path / "caf\udce9\x07"
    rods = write_rods(folder / "rods", bends=(0.0, 1.0), rings=12, sides=6)
    (rods / "thin\udcff7.off").symlink_to("nowhere")
    (rods / "thick7.off").write_bytes(b"OFF\n\xff")
    plugins = [
        write_plugin(
            folder / f"{name}.py",
            name=name,
            methods=f"def canonicalise(self, shape):\n        {text}",
        )
        for name, text in {
            "raises": f"raise ValueError({ODD})",
            "refuses": (
                "from benchmark.api import UnsupportedShape\n"
                f"        raise UnsupportedShape({ODD}, {ODD})"
            ),
            "prints": f"print({ODD})\n        return shape.form(shape.mesh.vertices)",
            "notes": f"return shape.form(shape.mesh.vertices, **{{{ODD}[:9]: 1.0}})",
        }.items()
    ]
    words = [
        "run",
        "-d",
        rods,
        "--input",
        "mesh",
        "--results",
        folder / "results",
        *LIGHT,
        "-j",
        "1",
    ]
    words += [word for plugin in plugins for word in ("--plugin", plugin)]
    command = [sys.executable, "-m", "benchmark", *map(os.fspath, words)]
    limit = (2**31, 2**31)  # less than a worker may take, as by ulimit -d
    lowered = lambda: resource.setrlimit(resource.RLIMIT_DATA, limit)  # noqa: E731
    done = subprocess.run(command, capture_output=True, check=False, preexec_fn=lowered)
    assert b"Traceback" not in done.stderr
    assert done.returncode == 1
    assert max(map(len, (done.stdout + done.stderr).splitlines())) < 3000
    assert not {0x1B, 0x07} & {*done.stderr, *done.stdout}
    records = {record.method: record for record in read_records(folder / "results")}
    assert {name: record.status for name, record in records.items()} == {
        "raises": "failed",
        "refuses": "unsupported",
        "prints": "ok",
        "notes": "failed",
    }
    assert {name for name, _ in records["prints"].unsupported} == {"thin\\udcff7", "thick7"}
    assert all(
        len(record.reason) <= 3000 and record.reason.isprintable() for record in records.values()
    )
    assert len(records["raises"].traceback) < 30_000
    states = call(
        "plan",
        "-d",
        folder / "rods",
        "--plugin",
        folder / "prints.py",
        "--input",
        "mesh",
        "--results",
        folder / "results",
        *LIGHT,
    )
    assert "\nfinished" in states  # after the two shapes that cannot be read
    assert states.endswith("0 of 1 jobs to run\n")


@pytest.mark.parametrize("name", ["title", "source", "stand_in_for"])
def test_a_record_escapes_what_it_may_not_hold(name, rods, tmp_path):
    record = run_toy(rods, tmp_path, "surface-area")["surface-area"]
    content = msgspec.to_builtins(record)
    content["data"][name] = "a\nb\x1b \udcff"
    assert record_of(content).data.__getattribute__(name).startswith("a b")
    assert msgspec.json.decode(msgspec.json.encode(record), type=Record) == record


def test_words_of_components_are_one_line():
    assert mesh_file_set(name="rods", title="a\nb", shapes=(Entry("a", "a", "0"),)).title == "a b"
    for facts in (
        {"title": "a\nb"},
        {"title": "a\x1b"},
        {"title": "\udcff"},
        {"title": 300 * "x"},
        {"summary": "a\nb"},
    ):
        with pytest.raises(ConfigurationError, match="does not fit"):
            MethodInfo(**{"name": "a", "title": "A", **facts})
    assert len(str(BenchmarkError(3_000_000 * "x", 3_000_000 * "y"))) < 5000
    assert locate(Silent()) == "Silent: Silent without a text (ValueError)"

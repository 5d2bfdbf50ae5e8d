"""The examples work far from the checkout."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.pipeline.record_files import read_records

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


@pytest.fixture
def far(tmp_path):
    """A folder outside of the checkout with the examples, and how a program is called there."""
    for path in EXAMPLES.glob("*.*"):
        shutil.copy(path, tmp_path)
    env = {name: value for name, value in os.environ.items() if name != "CANONICAL_FORMS_DATA"}

    def call(*arguments, code=0):
        done = subprocess.run(
            [sys.executable, "-m", *map(str, arguments)],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
            timeout=280,
            env=env,
        )
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout

    return call


@pytest.mark.slow
def test_the_tests_of_the_examples_pass_far_from_the_checkout(far):
    output = far("pytest", "-q", "-p", "no:cacheprovider", ".")
    passed, skipped = (
        sum(map(int, re.findall(rf"(\d+) {word}", output))) for word in ("passed", "skipped")
    )
    assert passed + skipped == sum(
        path.read_text().count("\ndef test_") for path in EXAMPLES.glob("test_*.py")
    )
    assert skipped == 2 * (shutil.which("g++") is None) + (shutil.which("octave-cli") is None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "status", "reason"),
    [
        ("kill -SEGV $$", "failed", "graph-stress ended with exit code -11"),
        (
            "echo too flat >&2; exit 2",
            "unsupported",
            "none of 4 shapes could be processed; thick0: too flat",
        ),
    ],
)
def test_a_program_may_crash_or_refuse(far, rods, tmp_path, source, status, reason):
    (tmp_path / "graph_stress").write_text(f"#!/bin/sh\n{source}")
    (tmp_path / "graph_stress").chmod(0o755)
    plugin = ("-m", "graph-stress", "--plugin", "graph_stress.py")
    far("benchmark", "run", "-d", rods, *plugin, "--input", "mesh", code=1)
    (record,) = read_records(tmp_path / "results")
    assert record.status == status
    assert reason in record.reason

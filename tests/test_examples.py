"""The examples work far from the checkout."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.pipeline.record_files import read_records
from tests.verbs import call

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


@pytest.mark.slow
def test_the_tests_of_the_examples_pass_far_from_the_checkout(tmp_path):
    for path in EXAMPLES.glob("*.*"):
        shutil.copy(path, tmp_path)
    env = {name: value for name, value in os.environ.items() if name != "CANONICAL_FORMS_DATA"}
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."]
    done = subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    output = done.stdout
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
def test_a_program_may_crash_or_refuse(
    rods, tmp_path, monkeypatch, in_this_process, source, status, reason
):
    shutil.copy(EXAMPLES / "graph_stress.py", tmp_path)
    (tmp_path / "graph_stress").write_text(f"#!/bin/sh\n{source}")
    (tmp_path / "graph_stress").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    plugin = ("-m", "graph-stress", "--plugin", "graph_stress.py")
    call("run", "-d", rods, *plugin, "--input", "mesh", code=1)
    (record,) = read_records(tmp_path / "results", published=False)
    assert record.status == status
    assert reason in record.reason

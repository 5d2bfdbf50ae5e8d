"""Processes that answer by the code of a tree."""

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[3]

#: A tree that starts a process of a session of its own, as a worker does, and never answers.
ENDLESS = """
import os, subprocess, sys, time
from pathlib import Path

child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True)
Path("begun.tmp").write_text(f"{os.getpid()} {child.pid}")
Path("begun.tmp").rename("begun")
time.sleep(60)
"""

ASKS = """
from pathlib import Path
from benchmark.jobs.rekey.trees import Tree, ask

ask(Tree(Path("tree").resolve(), "endless"), [{}], Path("answers"), lambda done: None)
"""


def test_what_answers_ends_with_a_program_that_is_killed(tmp_path):
    (tmp_path / "tree" / "benchmark").mkdir(parents=True)
    (tmp_path / "tree" / "benchmark" / "__main__.py").write_text(ENDLESS)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    program = subprocess.Popen([sys.executable, "-c", ASKS], cwd=tmp_path, env=environment)
    begun = tmp_path / "tree" / "begun"
    until(begun.exists)
    numbers = [int(number) for number in begun.read_text().split()]
    assert all(map(psutil.pid_exists, numbers))
    program.kill()
    program.wait()
    until(lambda: not any(map(psutil.pid_exists, numbers)))


def until(condition):
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)

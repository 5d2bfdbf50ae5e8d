"""Two runs on one folder: who does a job, and who clears away at the end."""

import subprocess
import sys
import time
from pathlib import Path

from benchmark.execution.claims import Claims

ROOT = Path(__file__).parents[2]

#: Claims a job, says so, and holds it until it is killed.
HOLDER = """
import sys, time
from pathlib import Path
from benchmark.execution.claims import Claims
claims = Claims(Path(sys.argv[1]))
assert claims.take(sys.argv[2])
print("taken", flush=True)
time.sleep(3600)
"""


def hold(folder, key):
    words = [sys.executable, "-c", HOLDER, str(folder), key]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout.readline() == "taken\n"
    return process


def test_a_job_of_another_run_is_not_taken_until_that_run_is_gone(tmp_path):
    with hold(tmp_path, "one") as other, Claims(tmp_path) as claims:
        assert not claims.take("one")
        assert claims.take("two")
        assert not claims.is_last()
        other.kill()
        other.wait()
        assert claims.take("one")
        assert claims.is_last()
    assert (tmp_path / "claims").read_bytes() == b""


def test_a_run_that_ends_before_another_leaves_its_scratch_alone(tmp_path, monkeypatch):
    from benchmark.cli.run import Settings, run_plan
    from benchmark.pipeline.storage.store import Store

    store = Store.open(tmp_path)
    (store.scratch / "needed.npz").write_text("")

    def run():
        return run_plan([], store, Settings(jobs=0))

    with hold(store.root, "one") as other:
        assert run()
        assert (store.scratch / "needed.npz").exists()
        other.kill()
    deadline = time.monotonic() + 20
    while (store.scratch / "needed.npz").exists() and time.monotonic() < deadline:
        assert run()
    assert not (store.scratch / "needed.npz").exists()

"""The process beside a dask worker: it answers line by line, and its worker does one task after the other."""

import json
import subprocess
import sys

import psutil
import pytest

from benchmark.jobs.execution.worker_pool import package_of
from benchmark.jobs.job_specs import ScoringTask, to_json
from tests.jobs.test_executors import orders


@pytest.fixture
def supervisor():
    words = [sys.executable, "-m", "benchmark.jobs.cluster.supervisor", "--stay"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def message(number, folder, name):
    (job,) = orders(folder, (name,))
    task = ScoringTask((job,))
    told = {"keys": [job.key], "results": str(folder), "status_file": f"1-a-{number}", "workers": 1}
    return json.dumps(told | {"task": to_json(task), "package": package_of(task)})


def test_tasks_of_a_package_are_done_in_one_process_which_goes_with_the_input(supervisor, tmp_path):
    workers = []
    for number, name in enumerate(("identity", "pca", "learned")):
        print(message(number, tmp_path, name), file=supervisor.stdin, flush=True)
        answer = json.loads(supervisor.stdout.readline())
        assert answer["exit_code"] == 0
        assert answer["status"]["is_done"]
        assert (tmp_path / "runs" / "records" / f"rods {name}.json").is_file(), "a record, if only of a failure"
        children = psutil.Process(supervisor.pid).children()
        workers.append({each.pid for each in children if "spawn_main" in " ".join(each.cmdline())})
    first, second, other = workers
    assert first == second
    assert len(first) == len(other) == 1
    assert not first & other, "another package"
    supervisor.stdin.close()
    assert supervisor.wait(20) == 0
    assert not any(map(psutil.pid_exists, other))
    assert list((tmp_path / "runs" / "progress").iterdir()) == []

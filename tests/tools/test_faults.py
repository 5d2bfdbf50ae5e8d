"""The fault program: a short round of it, a long one, and whether it would notice what it looks for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools import faults
from tools.faults import INNOCENT, Case

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux keeps them")

ROOT = Path(__file__).parents[2]


def program(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)


def test_names_tell_cases_apart():
    names = [name for name, _ in faults.all_cases()]
    assert len(set(names)) == len(names) > 300
    sections = ["kills", "plugins", "folders", "disks", "damage", "arguments"]
    assert list(dict.fromkeys(name.partition("/")[0] for name in names)) == sections


#: A case of each kind that takes seconds, and methods that end their worker, or leave something, each in its own way.
SHORT = ["arguments/00", "folders/set-manifest-twice", "plugins/method-ends-process-0"]
SHORT += ["plugins/method-interrupts", "plugins/method-children-of-a-crash"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_short_round_finds_nothing():
    done = program("-m", "pytest", *(f"tools/faults.py::test_fault[{name}]" for name in SHORT))
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("." * len(SHORT))


# Would it notice? ----------------------------------------------------------------------------------------------------


def leaves_a_process():
    subprocess.Popen(["sleep", "600"], start_new_session=True, env={})


def raises():
    raise ValueError(1)


def stands_still():
    subprocess.run(["sleep", "600"], check=False)


def exits_oddly():
    sys.exit(7)


def leaves_half_a_record(case: Case) -> None:
    (case.results / "runs" / "records").mkdir(parents=True)
    (case.results / "runs" / "records" / "a.json").write_text('{"key": "a", "status": "o')
    case.records()


def changes_scores(case: Case) -> None:
    case.run_all()
    case.check_scores(INNOCENT)
    assert case.crossings == []
    for path in (case.results / "runs" / "records").glob("*.json"):
        record = json.loads(path.read_text())
        path.write_text(json.dumps(record | {"scores": record["scores"] | {"NN": 0.123}}))
    case.check_scores(INNOCENT)


def of(function, **options):
    return lambda case: case.run(target=f"{__name__}:{function.__name__}", **options) and None


#: What each does, and what the program must say of it.
WRONG = {
    "own/orphan": (of(leaves_a_process), ["orphan"]),
    "own/traceback": (of(raises), ["traceback"]),
    "own/stall": (of(stands_still, seconds=0.5), ["stall"]),
    "own/code": (of(exits_oddly), ["exit code", "silence"]),
    "own/lost": (lambda case: case.check_scores(INNOCENT), ["lost"]),
    "own/half": (leaves_half_a_record, ["half record"]),
    "own/scores": (changes_scores, ["scores"]),
}


@pytest.mark.parametrize("name", WRONG)
def own(name, undisturbed, monkeypatch):
    monkeypatch.setattr(faults, "GRACE", 1.0)  # what is left does not end by itself
    act, kinds = WRONG[name]
    case = Case(name, *undisturbed)
    act(case)
    assert [crossing.partition(":")[0] for crossing in case.crossings] == kinds


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_it_notices_what_it_looks_for():
    """Run in a process that becomes the parent of all orphans."""
    done = program("-m", "pytest", "-o", "python_functions=own", "-p", "tools.faults", str(Path(__file__)))
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith("." * len(WRONG))

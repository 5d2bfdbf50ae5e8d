"""The fault program: a short round of it, a long one, and whether it would notice what it looks for."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tools import faults
from tools.faults import INNOCENT, SECTIONS, Case, all_cases, report

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux keeps them")

ROOT = Path(__file__).parents[2]


def program(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)


def test_names_tell_cases_apart():
    names = [case.name for case in all_cases(200)]
    assert len(set(names)) == len(names) > 300
    assert list(dict.fromkeys(name.partition("/")[0] for name in names)) == list(SECTIONS)


#: A case of each kind that takes seconds, and methods that end their worker, or leave something, each in its own way.
SHORT = ["arguments/00", "folders/set-manifest-twice", "plugins/method-ends-process-0"]
SHORT += ["plugins/method-interrupts", "plugins/method-children-of-a-crash"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_short_round_finds_nothing():
    done = program("-m", "tools.faults", *(word for name in SHORT for word in ("--only", name)))
    assert done.returncode == 0, done.stdout + done.stderr
    tried = dict(re.findall(r"^\| (\w+) \| \d+ \| (\d+) \|", done.stdout, re.MULTILINE))
    assert tried["arguments"] == "8"


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
    "own/error": (lambda case: 1 / 0, ["program"]),
}


def own() -> None:
    """Try the cases above in a process of their own, which becomes the parent of all orphans."""
    faults.GRACE = 1.0  # what is left will not go by itself
    tried = faults.attempted([Case(name, act) for name, (act, _) in WRONG.items()], seed=0)
    print(json.dumps({case.name: case.crossings for case in tried}))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_it_notices_what_it_looks_for():
    done = program("-c", f"from {__name__} import own; own()")
    assert done.returncode == 0, done.stderr
    crossings = json.loads(done.stdout.splitlines()[-1])
    kinds = {name: [said.partition(":")[0] for said in crossings[name]] for name in WRONG}
    assert kinds == {name: kinds for name, (_, kinds) in WRONG.items()}


def test_the_report_counts_by_section_and_says_how_to_do_it_again():
    cases = [Case("kills/000", of(raises)), Case("kills/001", of(raises)), Case("disks/two-runs", of(raises))]
    for case, tried in zip(cases, (5, 5, 1), strict=True):
        case.tried = tried
    cases[1].cross("lost: a.json")
    text = report(cases, seed=3)
    for row in ("| kills | 2 | 10 | 1 |", "| disks | 1 | 1 | 0 |", "| all | 3 | 11 | 1 |"):
        assert row in text
    assert "kills/001: lost: a.json\n    python -m tools.faults --only kills/001 --seed 3" in text

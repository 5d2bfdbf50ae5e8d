"""The profile of a run sums to the time of its workers, busy or idle."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.toy import write_rods
from tools.profile import account
from tools.profile.account import stage_of
from tools.profile.report import AFTER, BEFORE, BETWEEN, TAIL, Profile

# Two workers for ten seconds: one from 1 to 4 and from 5 to 9, the other from 1 to 6.
TASKS = [
    {"began": 1.0, "ended": 4.0, "parts": [["form", "gps", True, 2.0, 1.5], ["geodesics", "gps", False, 1.0, 0.5]]},
    {"began": 1.0, "ended": 6.0, "parts": [["form", "pca", False, 4.0, 3.0]]},
    {"began": 5.0, "ended": 9.0, "parts": [["measures", "gps", False, 4.0, 1.0]]},
]


def test_parts_sum_to_the_time_of_all_workers() -> None:
    profile = Profile(TASKS, workers=2, began=0.0, ended=10.0, processor=7.0)
    # One second of the second task is in no part.
    assert dict(profile.parts()) == {
        "form": 6.0, "geodesics": 1.0, "measures": 4.0, "else in a worker": 1.0,
        BEFORE: 2.0, AFTER: 2.0, BETWEEN: 1.0, TAIL: 3.0,
    }  # fmt: skip
    assert profile.parts().total() == profile.whole == 20.0


def test_the_tables_say_what_is_first_use_and_which_method_takes_most() -> None:
    text = Profile(TASKS, workers=2, began=0.0, ended=10.0, processor=7.0).markdown()
    assert text.startswith("10 s, 2 workers, 3 tasks; 7 s of processor time, 6 s of them in the workers.")
    assert "| form | 30.0% | 6.0 | 4.5 | 1.5 |" in text
    assert "| sum | 100.0% | 20.0 | 6.0 | 1.5 |" in text
    assert text.endswith("| gps | 1.5 | 0.0 | 0.0 | 1.0 | 41.7% |")


def test_time_belongs_to_the_innermost_body(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter(range(100))  # a second from one look at the clock to the next
    monkeypatch.setattr(account, "time", SimpleNamespace(perf_counter=lambda: next(now), process_time=lambda: 0.0))
    found = account.Account()
    with found.within("form", "gps"), found.within("geodesics", first=True):
        pass
    assert found.seconds == {
        ("else in a worker", "", False): 1,
        ("form", "gps", False): 2,
        ("geodesics", "gps", True): 1,
    }


@pytest.mark.slow
def test_a_run_prints_its_profile(tmp_path: Path) -> None:
    rods = write_rods(tmp_path / "rods")
    words = ["run", "-d", str(rods), "-m", "pca", "--input", "mesh", "-j", "1", "--results", str(tmp_path / "results")]
    said = subprocess.run([sys.executable, "-m", "tools.profile", *words], capture_output=True, text=True, check=True)
    assert " s, 1 workers, " in said.stdout
    parts = {line.split(" | ")[0]: line for line in said.stdout.splitlines() if line.startswith("| ")}
    assert {"| form", "| signature", "| distances", "| measures", "| prepare mesh", "| pca"} <= parts.keys()
    assert parts["| sum"].startswith("| sum | 100.0% |")


def test_works_have_the_names_of_stages() -> None:
    works = ("canonicalise mesh gps", "prepare view", "features", "load humans", "geodesics [('solver', 'default')]")
    assert [*map(stage_of, works)] == ["form", "prepare view", "signature", "making generated meshes", "geodesics"]

"""The fault program: a short round of it, a long one, and whether it would notice what it looks for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools.faults import commands
from tools.faults.cases import Border, Case, Crossing, Outcome
from tools.faults.program import run
from tools.faults.report import report
from tools.faults.scene import INNOCENT, Scene
from tools.faults.sections import SECTIONS, all_cases

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux keeps them")

ROOT = Path(__file__).parents[3]


def test_names_tell_cases_apart_and_the_seed_their_order():
    cases = all_cases(200)
    assert len({case.name for case in cases}) == len(cases)
    assert {case.section for case in cases} == set(SECTIONS)
    mixed = [case.name for case in all_cases(200, 1, shuffled=True)]
    assert mixed == [case.name for case in all_cases(200, 1, shuffled=True)]
    assert sorted(mixed) == sorted(case.name for case in cases)
    assert {name.partition("/")[0] for name in mixed[: len(SECTIONS)]} == set(SECTIONS)


#: One case of each kind that takes no more than a few seconds.
SHORT = ("arguments/00", "readers/off-0", "folders/set-manifest-twice")


@pytest.fixture(scope="module")
def outcomes():
    """Of a short round, and of cases that cross borders themselves, by name: one program, for its start takes long."""
    cases = [case for case in all_cases(1) if case.name in SHORT]
    cases += [Case(name, act) for name, (act, _) in CROSSING.items()]
    return {outcome.name: outcome for outcome in run(cases, seed=0)}


@pytest.mark.slow
def test_a_short_round_crosses_no_border(outcomes):
    assert [outcomes[name].crossings for name in SHORT] == [[], [], []]
    assert outcomes["arguments/00"].tried == 8
    assert outcomes["readers/off-0"].tried > 100


@pytest.mark.exhaustive
@pytest.mark.timeout(900)
def test_a_long_round_crosses_no_border():
    """Half a minute of everything, mixed."""
    command = [sys.executable, "-m", "tools.faults", "--seconds", "30", "--workers", "2"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f"| {section} |" in done.stdout for section in SECTIONS)


#: Bad methods that are tried whatever the long round draws: each ends its worker, or leaves something, in its own way.
EVERY_TIME = ("ends-process-0", "interrupts", "children-of-a-crash")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_bad_methods_cost_themselves_alone():
    names = [f"plugins/method-{name}" for name in EVERY_TIME]
    outcomes = run([case for case in all_cases(1) if case.name in names], seed=0)
    assert sorted(outcome.name for outcome in outcomes) == sorted(names)
    assert [crossing for outcome in outcomes for crossing in outcome.crossings] == []


# Would it notice? ----------------------------------------------------------------------------------------------------


def leaves_a_process():
    subprocess.Popen(["sleep", "600"], start_new_session=True, env={})


def raises():
    raise ValueError(1)


def stands_still():
    subprocess.run(["sleep", "600"], check=False)


def exits_oddly():
    sys.exit(7)


def says_nothing():
    sys.exit(1)


def _act(function, **options):
    return lambda scene: scene.command(target=f"{__name__}:{function.__name__}", **options) and None


def _leaves_an_orphan(scene: Scene) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(commands, "GRACE", 1.0)  # it will not go by itself
        _act(leaves_a_process)(scene)


def _loses_a_record(scene: Scene) -> None:
    scene.check_scores(INNOCENT)


def _leaves_half_a_record(scene: Scene) -> None:
    folder = scene.results / "runs" / "records"
    folder.mkdir(parents=True)
    (folder / "a.json").write_text('{"key": "a", "status": "o')
    scene.records()


def _changes_scores(scene: Scene) -> None:
    scene.begin_with_results()
    found = {path: json.loads(path.read_text()) for path in (scene.results / "runs" / "records").glob("*.json")}
    path, record = next((path, record) for path, record in found.items() if record["method"] == INNOCENT)
    scene.check_scores(INNOCENT)
    assert scene.outcome.crossings == []
    queries = [None if value is None else value / 2 for value in record["per_query"]["NN"]]
    record["per_query"]["NN"] = queries
    known = [value for value in queries if value is not None]
    record["scores"]["NN"] = sum(known) / len(known)
    path.write_text(json.dumps(record))
    scene.check_scores(INNOCENT)


#: What each does, and the borders that the program must see crossed.
CROSSING = {
    "own/orphan": (_leaves_an_orphan, {Border.ORPHAN}),
    "own/traceback": (_act(raises), {Border.TRACEBACK}),
    "own/stall": (_act(stands_still, seconds=0.5), {Border.STALL}),
    "own/code": (_act(exits_oddly), {Border.EXIT_CODE, Border.SILENCE}),
    "own/silence": (_act(says_nothing), {Border.SILENCE}),
    "own/lost": (_loses_a_record, {Border.LOST}),
    "own/half": (_leaves_half_a_record, {Border.HALF}),
    "own/scores": (_changes_scores, {Border.SCORES}),
    "own/error": (lambda scene: 1 / 0, {Border.PROGRAM}),
}


@pytest.mark.parametrize("name", CROSSING)
@pytest.mark.slow
def test_it_notices_what_it_looks_for(outcomes, name):
    assert {crossing.border for crossing in outcomes[name].crossings} == CROSSING[name][1]


# The report ----------------------------------------------------------------------------------------------------------

OUTCOMES = [
    Outcome("kills/000", tried=5, recoveries=[1.0, 3.0], seconds=9.0),
    Outcome("kills/001", tried=5, crossings=[Crossing(Border.LOST, "a.json")], recoveries=[2.0], seconds=8.0),
    Outcome("disks/two-runs", tried=1, seconds=4.0),
]


def test_the_report_counts_by_section_and_says_how_to_do_it_again():
    text = report(OUTCOMES, seed=3, seconds=21.4)
    assert "| kills | 2 | 10 | 1 | 1 | 0 | 0 | 0 | 2.0 | 3.0 |" in text
    assert "| disks | 1 | 1 | 0 | 0 | 0 | 0 | 0 |  |  |" in text
    assert "| all | 3 | 11 | 1 | 1 | 0 | 0 | 0 | 2.0 | 3.0 |" in text
    assert "kills/001: a finished record was lost or changed\n    a.json\n" in text
    assert "python -m tools.faults --only kills/001 --seed 3" in text

"""Progress of a run: counts and the time left are never cut."""

import io
import re

import pytest
from rich.console import Console

from benchmark.cli.progress import Bar, counting
from benchmark.runs.runner import Progress

WORKING = (
    "mesh-unfolding[iterations=200,step=0.25], woman-3_standing-on-one-leg",
    "learned-without-weighting, man-a1_x",
)


def lines_of(screen):
    """What stood in each line of a terminal, without codes."""
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue()).replace("\r", "\n")
    return [line.rstrip() for line in shown.split("\n")]


@pytest.mark.parametrize("width", [80, 160])
def test_a_narrow_terminal_cuts_what_runs_not_how_far_it_is(width):
    screen = io.StringIO()
    with Bar(
        12, 90.0, Console(file=screen, force_terminal=True, width=width, color_system=None)
    ) as bar:
        for done in range(0, 161, 40):
            bar.watch(Progress(done, 160, WORKING))
        bar.ended("ok           animals mesh gps", "NN .98 FT .76 ST .90 DCG .93  (.12 s)")
    lines = [line for line in lines_of(screen) if "steps" in line]
    assert max(map(len, lines)) <= width
    assert "0/12 jobs, 0:01:30 left" in lines[0]
    assert "160/160 steps, 1/12 jobs" in lines[-1]
    assert "left" not in lines[-1]
    assert "left | starting" in lines[0]
    assert "jobs | mesh-unf" in lines[-1]


def test_where_all_is_done_nothing_starts():
    screen = io.StringIO()
    with Bar(1, 0.0, Console(file=screen, force_terminal=True, width=80)) as bar:
        bar.watch(Progress(160, 160))
        bar.ended("ok           animals mesh gps", "NN .98")
    last = [line for line in lines_of(screen) if "steps" in line][-1]
    assert last.endswith("160/160 steps, 1/1 jobs")


@pytest.mark.parametrize(
    ("width", "lines"),
    [
        (
            60,
            [
                "ok           people[draw=0] fold 0 (quick) mesh gps",
                "  NN .76 FT .66 ST .88 DCG .83  (.01 s)",
            ],
        ),
        (
            120,
            [
                "ok           people[draw=0] fold 0 (quick) mesh gps   "
                "NN .76 FT .66 ST .88 DCG .83  (.01 s)"
            ],
        ),
    ],
)
def test_the_scores_of_a_job_are_never_broken(width, lines):
    screen = io.StringIO()
    with Bar(1, 0.0, Console(file=screen, force_terminal=True, width=width)) as bar:
        bar.ended(
            "ok           people[draw=0] fold 0 (quick) mesh gps ",
            "NN .76 FT .66 ST .88 DCG .83  (.01 s)",
        )
    shown = lines_of(screen)
    assert [line for line in shown if line and "steps" not in line] == lines


@pytest.mark.parametrize(("expected", "left"), [(11.0, "0:00:39"), (0.0, "1:14:12")])
def test_the_first_form_which_waits_for_kernels_counts_little_beside_an_estimate(
    expected, left, monkeypatch, capsys
):
    seconds = iter([0.0, 28.0, 28.0, 28.0])
    monkeypatch.setattr("benchmark.cli.progress.time.monotonic", lambda: next(seconds))
    bar = Bar(2, expected)
    bar.watch(Progress(1, 160, ("gps, cat0",)))
    assert f"1/160 steps, 0/2 jobs, {left} left" in capsys.readouterr().err


def test_without_a_terminal_a_line_now_and_then(monkeypatch, capsys):
    monkeypatch.setattr("benchmark.cli.progress.SECONDS_BETWEEN_LINES", 0.0)
    with Bar(2, 60.0) as bar:
        bar.watch(Progress(0, 10, ("gps, cat0",)))
        bar.ended("ok           rods mesh gps", "NN .98")
    assert capsys.readouterr().err.splitlines() == [
        "0/10 steps, 0/2 jobs, 0:01:00 left, gps, cat0",
        "ok           rods mesh gps  NN .98",
    ]


def test_items_are_yielded_and_counted_without_a_terminal(capsys, monkeypatch):
    assert list(counting("checking people[draw=0]", ["a", "b"])) == ["a", "b"]
    assert capsys.readouterr() == ("", "checking people[draw=0]: 1 of 2\n")
    monkeypatch.setattr("benchmark.cli.progress.SECONDS_BETWEEN_LINES", 0.0)
    assert list(counting("compiling kernels", ["gps", "mds"], name=str)) == ["gps", "mds"]
    assert capsys.readouterr().err.splitlines() == [
        "compiling kernels: 1 of 2, gps",
        "compiling kernels: 2 of 2, mds",
    ]


def test_a_bar_counts_and_names_items_in_a_terminal(capsys, monkeypatch):
    screen = io.StringIO()
    terminal = Console(file=screen, force_terminal=True, width=100, color_system=None)
    monkeypatch.setattr("benchmark.cli.progress.Console", lambda **_: terminal)
    assert list(counting("compiling kernels", ["gps", "mds[x=1]"], name=str)) == ["gps", "mds[x=1]"]
    assert "compiling kernels: 2 of 2, mds[x=1]" in screen.getvalue()
    assert capsys.readouterr() == ("", "")

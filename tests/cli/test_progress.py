"""Progress of a run where there is no terminal."""

from benchmark.cli import run_plan
from tests.execution.test_executors import orders


def test_one_shape_that_is_waited_for_is_named_in_place_of_an_estimate(tmp_path, monkeypatch, capsys):
    clock = iter([0.0, *range(1, 100, 15)])
    monkeypatch.setattr(run_plan.time, "monotonic", lambda: next(clock))
    display = run_plan._Display(orders(tmp_path, ("identity",)))
    for done in (0, 1, 2, 2):
        display.watch(["rods mesh identity, big"], done)
    assert capsys.readouterr().err.splitlines() == [
        "1 of 3 shapes after 16 s, about 32 s left",
        "2 of 3 shapes after 31 s, about 16 s left",
        "2 of 3 shapes after 46 s, rods mesh identity, big",
    ]

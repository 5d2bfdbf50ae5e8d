"""Progress of a run where there is no terminal."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from benchmark.cli import run as run_module
from benchmark.cli.main import cli
from tests.execution.test_executors import orders
from tests.toy import write_rods


def test_one_shape_that_is_waited_for_is_named_in_place_of_an_estimate(tmp_path, monkeypatch, capsys):
    clock = iter([0.0, *range(1, 100, 15)])
    monkeypatch.setattr(run_module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    display = run_module._Display(orders(tmp_path, ("identity",)))
    for done in (0, 1, 2, 2):
        display.watch(["rods mesh identity, big"], done)
    assert capsys.readouterr().err.splitlines() == [
        "1 of 3 shapes after 16 s, about 32 s left",
        "2 of 3 shapes after 31 s, about 16 s left",
        "2 of 3 shapes after 46 s, rods mesh identity, big",
    ]


@pytest.mark.parametrize("compiled", [[], [Path("module.kernel.nbi")]])
def test_the_first_run_says_that_kernels_are_compiled(compiled, tmp_path, monkeypatch):
    monkeypatch.setattr(run_module, "compiled_kernels", lambda source: compiled)
    words = ["-d", str(write_rods(tmp_path / "rods")), "-m", "surface-area", "--input", "mesh", "-j", "0"]
    done = CliRunner().invoke(cli, ["run", *words, "--results", str(tmp_path / "results")])
    assert done.exit_code == 0, done.output
    assert ("compiles kernels" in done.stderr) == (not compiled)

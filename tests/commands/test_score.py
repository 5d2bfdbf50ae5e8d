"""``score`` of a matrix imports what reads and scores matrices, and nothing of runs."""

import subprocess
import sys

import numpy as np
from pandas import DataFrame

from benchmark.cli.scores import _print_evaluation
from benchmark.commands.score import Evaluation

PROGRAM = """
import sys
from benchmark.cli.main import cli

try:
    cli(sys.argv[1:], standalone_mode=False)
finally:
    print(*sys.modules, sep="\\n", file=sys.stderr)
"""


def test_score_imports_no_runner_no_protocols_and_no_torch(tmp_path):
    places = np.random.default_rng(0).random((12, 2))
    distances = np.linalg.norm(places[:, None] - places, axis=2)
    np.savetxt(tmp_path / "distances.txt", distances)
    (tmp_path / "labels.txt").write_text("\n".join("aaaabbbbcccc"))
    words = ["score", tmp_path / "distances.txt", "--labels", tmp_path / "labels.txt"]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, words)],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "NN" in done.stdout
    modules = done.stderr.splitlines()
    unwanted = ("runs", "protocols", "pipeline", "registry", "datasets.folder", "depth", "geometry")
    names = tuple(f"benchmark.{name}" for name in unwanted)
    others = ("torch", "numba", "matplotlib", "trimesh", "pymeshlab", "igl", "sklearn")
    assert [name for name in modules if name.startswith((*names, *others))] == []


def test_scores_are_rounded_as_those_of_tables(capsys):
    columns = {"score": [0.125], "low": [np.nan], "high": [np.nan], "chance": [0.375]}
    evaluation = Evaluation(DataFrame(columns, index=["NN"]), DataFrame(), np.zeros((0, 0)))
    _print_evaluation(evaluation, "mine", "text")
    assert capsys.readouterr().out.split()[-5:] == ["NN", "0.13", "--", "--", "0.38"]
    _print_evaluation(evaluation, "mine", "latex")
    assert "mine & .13 & " in capsys.readouterr().out

"""Whatever the degree of a vertex, a method gives a form or says why not: it never ends the process.

A capped cylinder of n sides has two vertices of degree n. The commands run in processes of their own, because what is
looked for would end this one.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmark.geometry.io import read_mesh, write_mesh
from benchmark.plugins.registry import methods
from tests.geometry.surfaces import capped_cylinder

ROOT = Path(__file__).parents[2]

#: Prints a line for each method, so that the last line names the one that ended the process.
ALL_METHODS = """
import sys
from pathlib import Path
from benchmark.machine import pin_threads
pin_threads()
from benchmark.cli.forms import Request, plain_form
from benchmark.errors import BenchmarkError
from benchmark.geometry.io import write_mesh
from benchmark.geometry.mesh import Mesh
from benchmark.plugins.registry import methods

for name in methods():
    print(name, end=" ", flush=True)
    try:
        vertices, faces, _ = plain_form(Path(sys.argv[1]), Request(name))
        write_mesh(Path(sys.argv[2]) / f"{name}.off", Mesh(vertices, faces))
        print("form", flush=True)
    except BenchmarkError as error:
        print("refused:", str(error).replace(chr(10), " "), flush=True)
"""


def write_cylinder(folder: Path, sides: int) -> Path:
    path = folder / f"cylinder{sides}.off"
    write_mesh(path, capped_cylinder(sides))
    return path


def extent_of_form(path: Path) -> float:
    vertices = read_mesh(path).vertices
    assert np.isfinite(vertices).all()
    return float(np.ptp(vertices, axis=0).max())


@pytest.mark.parametrize(
    "sides",
    [
        *(pytest.param(sides, marks=pytest.mark.slow) for sides in (3, 799)),
        *(pytest.param(sides, marks=pytest.mark.exhaustive) for sides in (4, 5, 50, 500, 700, 3000)),
    ],
)
def test_every_method_gives_a_form_or_a_named_refusal(tmp_path, sides):
    source = write_cylinder(tmp_path, sides)
    command = [sys.executable, "-c", ALL_METHODS, str(source), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    outcomes = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert set(outcomes) == set(methods())
    for name, outcome in outcomes.items():
        if outcome == "form":
            assert extent_of_form(tmp_path / f"{name}.off") > 0, name
    # Whoever reads the mesh can treat it; a network may see in the depth image what is no surface.
    refusing = {name for name, outcome in outcomes.items() if outcome != "form"}
    describing = {name for name in refusing if "describes shapes without a canonical form" in outcomes[name]}
    assert describing == {"surface-area", "shape-dna", "sd-gdm", "si-hks"}
    assert all(methods()[name].learns for name in refusing - describing), outcomes

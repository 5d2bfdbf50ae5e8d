"""What Graph Stress promises."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from graph_stress import GraphStress

from benchmark.api import Shape
from benchmark.check import failures
from benchmark.check.shapes import figure

PROGRAM = Path(__file__).with_name("graph_stress")


@pytest.fixture(scope="module", autouse=True)
def _program() -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no g++")
    subprocess.run(["g++", "-O2", "-o", PROGRAM, PROGRAM.with_suffix(".cpp")], check=True)


def test_it_keeps_the_contract() -> None:
    assert not failures(GraphStress)


def test_distances_come_closer_to_those_along_the_surface() -> None:
    shape = Shape(identifier="figure", mesh=figure())
    form = GraphStress().canonicalise(shape)
    before, after = (
        np.abs(np.linalg.norm(points[:, None] - points, axis=2) - shape.geodesics()).mean()
        for points in (shape.mesh.vertices, form.vertices)
    )
    assert after < 0.6 * before

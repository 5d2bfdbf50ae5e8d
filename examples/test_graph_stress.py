"""What Graph Stress promises."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmark.api import Shape
from benchmark.plugins.conformance import check_target, figure
from benchmark.plugins.registry import plugin_methods

PLUGIN = Path(__file__).with_name("graph_stress.py")


@pytest.fixture(scope="module", autouse=True)
def _program() -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no g++")
    program = PLUGIN.with_suffix("")
    subprocess.run(["g++", "-O2", "-o", program, program.with_suffix(".cpp")], check=True)


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_distances_come_closer_to_those_along_the_surface() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    form = spec.load()().canonicalise(shape)
    before, after = (
        np.abs(np.linalg.norm(points[:, None] - points, axis=2) - shape.geodesics()).mean()
        for points in (shape.mesh.vertices, form.vertices)
    )
    assert after < 0.6 * before

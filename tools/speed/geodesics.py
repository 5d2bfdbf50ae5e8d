"""Geodesic distances of all pairs beside the heat method, with the error of both."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmark.datasets.humans import Humans
from benchmark.geometry import geodesics
from benchmark.geometry.preparation import prepare
from tools.speed.timing import Row, least

SHAPES, SOURCES, REPEATS = 10, 50, 2


def measure() -> Iterator[Row]:
    """Median over prepared humans; errors are relative to exact distances from some vertices."""
    humans, random = Humans(), np.random.default_rng(0)
    places = np.linspace(0, len(humans.entries) - 1, SHAPES).round().astype(int)
    meshes = [prepare(humans.load(humans.entries[place])).mesh for place in places]
    sources = random.choice(min(mesh.n_vertices for mesh in meshes), SOURCES, replace=False)
    exact = [geodesics.from_sources(mesh, sources, "exact") for mesh in meshes]
    seconds, errors = {}, {}
    for solver in (geodesics.DEFAULT_SOLVER, "heat"):
        seconds[solver] = np.median([least(partial(geodesics.all_pairs, m, solver), REPEATS) for m in meshes])
        misses = [
            np.abs(geodesics.all_pairs(mesh, solver)[sources] - truth)[truth > 0] / truth[truth > 0]
            for mesh, truth in zip(meshes, exact, strict=True)
        ]
        errors[solver] = 100 * np.concatenate(misses).mean()
    ours = geodesics.DEFAULT_SOLVER
    detail = f"{SHAPES} shapes of 2000 vertices, mean error {errors[ours]:.3f} % (peer {errors['heat']:.2f} %)"
    peer = "potpourri3d heat method"
    yield Row("all geodesics of one shape", float(seconds[ours]), detail, peer, float(seconds["heat"]))

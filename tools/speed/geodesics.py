"""Accuracy and time of the geodesic solvers: ``python -m tools.speed.geodesics [--data-root DIR]`` prints the tables.

Errors are relative to exact geodesics [Mitchell, Mount and Papadimitriou 1987] from 50 random vertices of each shape.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import argparse  # noqa: E402
import os  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Mapping, Sequence  # noqa: E402
from concurrent.futures import ProcessPoolExecutor  # noqa: E402
from functools import partial  # noqa: E402
from multiprocessing import get_context  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from benchmark.datasets.base import Dataset  # noqa: E402
from benchmark.datasets.humans import Humans  # noqa: E402
from benchmark.datasets.official.tosca import tosca  # noqa: E402
from benchmark.geometry import geodesics  # noqa: E402
from benchmark.geometry.geodesic_graph import WINDOWS, geodesic_graph  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.geometry.shortest_paths import shortest_paths  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from tools.speed._timing import least_seconds, row  # noqa: E402

FloatArray = NDArray[np.float64]
SHAPES_PER_SET = 10
SOURCES = 50
LARGEST_MEAN_ERROR = 0.02
MOST_SECONDS = 0.12
REPEATS = 2
BUDGETS = (50, 100, 200, 400, 800, 1600)
APPROXIMATE = tuple(solver for solver in geodesics.SOLVERS if solver != "exact")


def sample(data_root: Path | None) -> dict[str, list[Mesh]]:
    """Prepare shapes spread evenly over each set, by set; TOSCA only where its data is."""
    sets: list[Dataset] = [Humans()] + ([tosca(data_root)] if data_root else [])
    return {
        each.name: [
            prepare(each.load(each.entries[int(at)])).mesh
            for at in np.linspace(0, len(each.entries) - 1, SHAPES_PER_SET).round()
        ]
        for each in sets
    }


def exact_rows(mesh: Mesh) -> tuple[NDArray[np.int64], FloatArray]:
    """Return random sources and the exact distances from them."""
    sources = np.random.default_rng(0).choice(mesh.n_vertices, SOURCES, replace=False)
    return sources, geodesics.from_sources(mesh, sources, "exact")


def relative_errors(distances: FloatArray, exact: FloatArray) -> FloatArray:
    """Return the relative errors of all pairs of different vertices."""
    return (np.abs(distances - exact) / np.where(exact > 0, exact, 1.0))[exact > 0]


def by_windows(mesh: Mesh, windows: int) -> FloatArray:
    """Return all distances on the geodesic graph of another budget."""
    return shortest_paths(geodesic_graph(mesh, windows), np.arange(mesh.n_vertices))


def compare(
    meshes: Sequence[Mesh],
    exact: Sequence[tuple[NDArray[np.int64], FloatArray]],
    solvers: Mapping[str, Callable[[Mesh], FloatArray]],
) -> list[dict[str, Any]]:
    """Return error and time of each solver over all meshes."""
    rows = []
    for name, solve in solvers.items():
        errors = [
            relative_errors(solve(mesh)[sources], truth) for mesh, (sources, truth) in zip(meshes, exact, strict=True)
        ]
        pooled = np.concatenate(errors)
        rows.append(
            {
                "solver": name,
                "mean": 100 * pooled.mean(),
                "p95": 100 * np.percentile(pooled, 95),
                "max": 100 * pooled.max(),
                "worst_mean": 100 * max(each.mean() for each in errors),
                "seconds": float(np.median([least_seconds(partial(solve, mesh), REPEATS) for mesh in meshes])),
            }
        )
    return rows


def two_processes(meshes: Sequence[Mesh], solver: str) -> float:
    """Return seconds per shape when two processes share the shapes."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(_all_pairs, [(meshes[0], solver)] * 4))
        start = time.perf_counter()
        list(pool.map(_all_pairs, [(mesh, solver) for mesh in meshes]))
        return (time.perf_counter() - start) / len(meshes)


def _all_pairs(job: tuple[Mesh, str]) -> float:
    return float(geodesics.all_pairs(*job).sum())


def measure() -> list[dict[str, Any]]:
    """Compare the default solver with the heat method of potpourri3d on prepared humans."""
    meshes = sample(None)["humans"]
    ours, heat = compare(
        meshes,
        [exact_rows(mesh) for mesh in meshes],
        {name: partial(_solve, solver=name) for name in (geodesics.DEFAULT_SOLVER, "heat")},
    )
    agreement = f"mean error against exact geodesics {ours['mean']:.3f} % (peer {heat['mean']:.2f} %)"
    rows = []
    for place, clock, most, pair in (
        ("one core", "processor", MOST_SECONDS, [each["seconds"] for each in (ours, heat)]),
        ("2 cores", "wall", np.inf, [two_processes(meshes, name) for name in (geodesics.DEFAULT_SOLVER, "heat")]),
    ):
        limit = f", at most {most} s" if np.isfinite(most) else ""
        rows.append(
            row(
                f"all geodesics of one shape on {place}",
                pair[0],
                clock=clock,
                peer="potpourri3d heat method",
                peer_seconds=pair[1],
                target=f"mean error at most {LARGEST_MEAN_ERROR} %, no slower{limit}",
                met=ours["mean"] <= LARGEST_MEAN_ERROR and pair[0] <= min(pair[1], most),
                detail=f"{agreement}, {len(meshes)} shapes of 2000 vertices",
            )
        )
    return rows


def _solve(mesh: Mesh, solver: str) -> FloatArray:
    return geodesics.all_pairs(mesh, solver)


def _print(title: str, rows: Sequence[dict[str, Any]], heat_seconds: float) -> None:
    print(f"\n### {title}\n")
    head = ["solver", "mean %", "95th percentile %", "max %", "worst shape, mean %", "seconds", "time / heat"]
    columns = ("mean", "p95", "max", "worst_mean", "seconds")
    body = [
        [each["solver"], *(f"{each[name]:.3f}" for name in columns), f"{each['seconds'] / heat_seconds:.2f}"]
        for each in rows
    ]
    print("\n".join(markdown_table(head, body, len(head))), flush=True)


def main() -> None:
    """Print the tables of docs/appendix/geodesics.md."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--data-root", type=Path, default=os.environ.get("CANONICAL_FORMS_DATA"))
    shapes = sample(parser.parse_args().data_root)
    heat, few, few_exact = [], list[Mesh](), list[Any]()
    for name, meshes in shapes.items():
        exact = [exact_rows(mesh) for mesh in meshes]
        rows = compare(meshes, exact, {solver: partial(_solve, solver=solver) for solver in APPROXIMATE})
        heat.append(next(row["seconds"] for row in rows if row["solver"] == "heat"))
        start = time.process_time()
        exact_rows(meshes[0])
        per_shape = (time.process_time() - start) * meshes[0].n_vertices / SOURCES
        zero = dict.fromkeys(("mean", "p95", "max", "worst_mean"), 0.0)
        rows.append({"solver": f"exact (time from {SOURCES} sources)", **zero, "seconds": per_shape})
        _print(f"{name}: {len(meshes)} shapes", rows, heat[-1])
        few += meshes[:: SHAPES_PER_SET // 3]
        few_exact += exact[:: SHAPES_PER_SET // 3]
    budgets = {f"{windows} windows": partial(by_windows, windows=windows) for windows in BUDGETS}
    title = f"Budget of the geodesic graph (used: {WINDOWS}), {len(few)} of these shapes"
    _print(title, compare(few, few_exact, budgets), float(np.mean(heat)))


if __name__ == "__main__":
    main()

"""Programs that collapse edges, compared: ``python -m tools.speed.decimation``; writes ``results/decimation.json``.

Processor time of one thread; distances between the surfaces in roots of the area.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
import os  # noqa: E402
from collections.abc import Iterator  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import igl  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from benchmark.datasets.catalogue import is_present, open_dataset  # noqa: E402
from benchmark.datasets.decimated import DECIMATIONS, N_VERTICES, is_installed  # noqa: E402
from benchmark.geometry.cleaning import clean, make_manifold  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.geometry.preparation import decimate  # noqa: E402
from benchmark.system.text import DATA_VARIABLE  # noqa: E402
from tools.speed._document import DECIMATION, machine, write_document  # noqa: E402
from tools.speed._timing import least_seconds  # noqa: E402

#: Shapes of each set, spread over its classes.
SETS = {"tosca": 12, "humans": 6, "humans-scanlike": 6}
SAMPLES, REPEATS = 20_000, 2
PYMESHLAB = "pymeshlab"


def main() -> None:
    """Measure every program on every set that is here, and write the document."""
    root = os.environ.get(DATA_VARIABLE)
    rows = [row for name in SETS for row in of_set(name, Path(root) if root else None)]
    DECIMATION.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
    print(f"wrote {DECIMATION} and {write_document()}")


def of_set(name: str, root: Path | None) -> Iterator[dict[str, Any]]:
    """A row for each program on some shapes of a set; none where the set is absent."""
    if not is_present(name, root):
        return
    dataset = open_dataset(name, root)
    entries = dataset.entries[:: -(-len(dataset.entries) // SETS[name])]
    meshes = [unit(dataset.load(entry)) for entry in entries]
    for program in (PYMESHLAB, *DECIMATIONS):
        if program != PYMESHLAB and not is_installed(program):
            continue
        found = [measured(mesh, program) for mesh in meshes]
        means = {key: float(np.mean([each[key] for each in found])) for key in ("seconds", "mean", "angle")}
        row = {
            "set": name,
            "program": program,
            "shapes": len(meshes),
            "vertices": max(mesh.n_vertices for mesh in meshes),
            **means,
            "largest": max(each["largest"] for each in found),
            "non_manifold": sum(each["non_manifold"] > 0 for each in found),
        }
        print(row, flush=True)
        yield row


def unit(mesh: Mesh) -> Mesh:
    """The cleaned mesh, opened where it is no manifold, of unit area at the origin."""
    found = make_manifold(clean(mesh)[0])
    return found.with_vertices((found.vertices - found.vertices.mean(axis=0)) / np.sqrt(found.area))


def measured(mesh: Mesh, program: str) -> dict[str, float]:
    """Time, distances either way, angles in degrees that one in a hundred faces has less than, and faults."""
    if program == PYMESHLAB:
        work = partial(decimate, mesh, N_VERTICES)
    else:
        work = partial(DECIMATIONS[program], mesh, mesh.n_faces - 2 * (mesh.n_vertices - N_VERTICES))
    found = work()
    there, back = away(mesh, found), away(found, mesh)
    report = clean(found)[1]
    return {
        "seconds": least_seconds(work, REPEATS),
        "mean": (there.mean() + back.mean()) / 2,
        "largest": max(there.max(), back.max()),
        "angle": float(np.percentile(smallest_angles(found), 1)),
        "non_manifold": report.non_manifold_edges + report.non_manifold_vertices + report.duplicate_faces,
    }


def away(mesh: Mesh, other: Mesh) -> NDArray[np.float64]:
    """Distances of points spread evenly over a surface from another surface."""
    random = np.random.default_rng(0)
    chosen = random.choice(mesh.n_faces, SAMPLES, p=mesh.face_areas / mesh.face_areas.sum())
    weights = random.dirichlet(np.ones(3), SAMPLES)
    points = (weights[:, :, None] * mesh.vertices[mesh.faces[chosen]]).sum(axis=1)
    return np.sqrt(igl.point_mesh_squared_distance(points, other.vertices, other.faces.astype(np.int64))[0])


def smallest_angles(mesh: Mesh) -> NDArray[np.float64]:
    """The smallest angle of each face, in degrees."""
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    return np.degrees(np.arccos(np.clip(-(sides * np.roll(sides, 1, axis=1)).sum(axis=2), -1, 1))).min(axis=1)


if __name__ == "__main__":
    main()

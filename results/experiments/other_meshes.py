"""How much another mesh of the same shapes moves scores: five classes of TOSCA in five meshes.

    python results/experiments/other_meshes.py make DATA_ROOT FOLDER     # writes the meshes
    python results/experiments/other_meshes.py run FOLDER                # scores them; it resumes
    python results/experiments/other_meshes.py judge FOLDER              # writes other-meshes.csv

The meshes are those of the known copy, and what two programs make of them: each decimates them and
re-meshes them. Only the meshes differ, so that the scatter of a score over them is due to them.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from benchmark.api.contracts import Mesh
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.mesh_files import write_mesh
from benchmark.pipeline.record_files import read_records
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.report.notation import hundredths

if TYPE_CHECKING:
    import pymeshlab

#: The animals: of people, classes of one person each are all alike.
CLASSES = ("cat", "dog", "gorilla", "horse", "wolf")

#: Methods: two forms that need geodesics, one that needs none, none at all, and two descriptors.
METHODS = ("classic-mds", "mesh-unfolding", "gps", "identity", "shape-dna", "surface-area")

#: Triangles after decimation, and after re-meshing: those of the copy.
DECIMATED = 8000
WHOLE = 10000

#: Draws of the codebook in a record.
DRAWS = 3

TABLE = Path(__file__).with_name("other-meshes.csv")


def of_meshlab(mesh: Mesh) -> pymeshlab.MeshSet:
    """Return a set with the mesh for pymeshlab."""
    import pymeshlab  # lazy: what was scored needs no program for meshes

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    return meshes


def decimated_by_meshlab(mesh: Mesh) -> Mesh:
    """Collapse edges by quadric errors."""
    meshes = of_meshlab(mesh)
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=DECIMATED, preservetopology=True)
    current = meshes.current_mesh()
    return Mesh(current.vertex_matrix(), current.face_matrix())


def remeshed_by_meshlab(mesh: Mesh) -> Mesh:
    """Re-mesh isotropically, with edges as long as those of as many equilateral triangles."""
    import pymeshlab

    meshes = of_meshlab(mesh)
    length = float(np.sqrt(mesh.area / WHOLE * 4 / np.sqrt(3)))
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=10, targetlen=pymeshlab.PureValue(length)
    )
    current = meshes.current_mesh()
    return Mesh(current.vertex_matrix(), current.face_matrix())


def collapsed(vertices: np.ndarray, faces: np.ndarray, n_faces: int) -> Mesh:
    """Collapse edges by libigl's quadric errors."""
    import igl

    points, triangles, *_ = igl.qslim(np.asarray(vertices), np.asarray(faces), n_faces)
    return Mesh(points, triangles)


def decimated_by_libigl(mesh: Mesh) -> Mesh:
    """Collapse edges by quadric errors, in another program."""
    return collapsed(mesh.vertices, mesh.faces.astype(np.int64), DECIMATED)


def remeshed_by_trimesh(mesh: Mesh) -> Mesh:
    """Split all triangles in four by trimesh, and collapse as many by libigl: other vertices on the
    same surface.
    """
    import trimesh

    return collapsed(*trimesh.remesh.subdivide(mesh.vertices, mesh.faces.astype(np.int64)), WHOLE)


MESHES: dict[str, Callable[[Mesh], Mesh]] = {
    "copy": lambda mesh: mesh,
    "decimated-pymeshlab": decimated_by_meshlab,
    "re-meshed-pymeshlab": remeshed_by_meshlab,
    "decimated-libigl": decimated_by_libigl,
    "re-meshed-trimesh": remeshed_by_trimesh,
}


def make(data_root: Path, folder: Path) -> None:
    """Write the meshes, a folder for each of the programs."""
    shapes = open_dataset("tosca", data_root)
    for name, changed in MESHES.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for entry in shapes.shapes:
            if entry.subject in CLASSES:
                write_mesh(folder / name / f"{entry.identifier}.off", changed(shapes.load(entry)))


def run(folder: Path) -> None:
    """Score all meshes by all methods."""
    chosen: list[str] = []
    for name in METHODS:
        chosen += ["-m", name]
    for name in MESHES:
        words = ["-d", str(folder / name), "--input", "mesh", "--results", str(folder / "results")]
        command = [sys.executable, "-m", "benchmark", "run", *words, *chosen]
        subprocess.run(command, check=True)


def judge(folder: Path) -> None:
    """Write the scores, and print their scatter over meshes beside that over codebooks.

    Raises ``SystemExit`` before all meshes are scored.
    """
    rows = []
    for record in read_records(folder / "results", published=False):
        for measure in PAPER_MEASURES:
            if measure in record.scores:
                rows.append(
                    {
                        "mesh": record.data.name,
                        "method": record.method,
                        "measure": measure,
                        "value": record.scores[measure],
                        "codebooks": np.sqrt(DRAWS) * record.draw_errors.get(measure, np.nan),
                    }
                )
    scored = {(row["mesh"], row["method"]) for row in rows}
    missing = [" ".join(pair) for pair in product(MESHES, METHODS) if pair not in scored]
    if missing:
        raise SystemExit(f"these rows have not run: {', '.join(missing)}")
    scores = pd.DataFrame(rows).sort_values(["method", "measure", "mesh"])
    scores.to_csv(TABLE, index=False, float_format="%.6f", lineterminator="\n")
    print("\n".join(lines(scores)))


def lines(scores: pd.DataFrame) -> list[str]:
    """Return the scatter over meshes beside that over codebooks, and the range, as a table in
    Markdown.
    """
    heads = ["over meshes: NN FT ST DCG", "over codebooks", "least to most DCG"]
    said = [f"| method | {' | '.join(heads)} |", "|---|---|---|---|"]
    for method, group in scores.groupby("method", sort=False):
        of = group.groupby("measure").agg({"value": ["std", "min", "max"], "codebooks": "mean"})
        of = of.reindex(PAPER_MEASURES)
        meshes = " ".join(map(thousandths, of["value", "std"]))
        books = " ".join(map(thousandths, of["codebooks", "mean"]))
        ends = " to ".join(hundredths(of.loc["DCG", ("value", end)]) for end in ("min", "max"))
        said.append(f"| {method} | {meshes} | {'' if 'nan' in books else books} | {ends} |")
    return said


def thousandths(value: float) -> str:
    """Return a standard deviation with three decimals."""
    return f"{value:.3f}".removeprefix("0")


if __name__ == "__main__":
    verb, *places = sys.argv[1:]
    {"make": make, "run": run, "judge": judge}[verb](*map(Path, places))

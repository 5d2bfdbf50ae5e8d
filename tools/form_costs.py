"""``python -m tools.form_costs``: seconds of each form on surfaces of several sizes, as a CSV file.

The seconds are those of a processor, for the form with its geodesic distances, as in the tables.
"""

from __future__ import annotations

from benchmark.machine import pin_threads

pin_threads()

import csv  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402

from benchmark.api.contracts import Mesh, Shape  # noqa: E402
from benchmark.datasets.catalogue import open_dataset  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.registry import select_one  # noqa: E402
from benchmark.text import say  # noqa: E402

#: Where the seconds are kept.
COSTS = Path(__file__).parents[1] / "results" / "figures" / "form-costs.csv"

#: Numbers of vertices of the surfaces.
SIZES = (500, 1000, 2000, 5000)

#: Generated shape that is measured.
SHAPE = "michael0"

#: Methods in the order of the guide.
METHODS = (
    "classic-mds",
    "fast-mds",
    "accelerated-mds",
    "fast-classical-scaling",
    "least-squares-mds",
    "non-metric-mds",
    "gps",
    "constrained-mds",
    "feature-preserved",
    "mesh-unfolding",
    "skeleton",
)


def main() -> None:
    """Measure all methods, and write their seconds."""
    animals = open_dataset("animals")
    (entry,) = [entry for entry in animals.shapes if entry.identifier == SHAPE]
    whole = animals.load(entry)
    lines: list[tuple[str, int, str]] = []
    for size in SIZES:
        mesh = prepare(whole, size).mesh
        for name in METHODS:
            if size == SIZES[0]:
                seconds_of_form(name, mesh)  # compiles what is not compiled yet
            seconds = seconds_of_form(name, mesh)
            lines.append((name, size, f"{seconds:.2g}"))
            say(f"{name} {size} {seconds:.2g}")
    with COSTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("method", "vertices", "seconds"))
        writer.writerows(sorted(lines, key=lambda line: METHODS.index(line[0])))


def seconds_of_form(name: str, mesh: Mesh) -> float:
    """Return the seconds of the form of a new surface, for which no distances are kept."""
    method = select_one(name).create()
    shape = Shape(identifier="body", mesh=Mesh(mesh.vertices.copy(), mesh.faces.copy()))
    start = time.process_time()
    method.canonicalise(shape)
    return time.process_time() - start


if __name__ == "__main__":
    main()

"""``python -m tools.studies.scan_pictures -o FILE``: scans that are trained on, and scans that validate, of ten bodies.

Each pair of lines shows the same bodies: above as training sees its own, below as :mod:`tools.studies.range_scanning`
leaves them. All are drawn as prepared for a comparison.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from benchmark.datasets.scans.bodies import WideBodies
from benchmark.datasets.scans.sampler import scan
from benchmark.datasets.varied.sampler import height_of
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import camera_coordinates
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.report.pictures.forms import WIDTH, save
from benchmark.report.pictures.painting import painted
from benchmark.report.pictures.posing import reach
from tools.studies.field_detail import RANKED
from tools.studies.range_scanning import range_scan

COLUMNS = 5
SIZE = 320


@click.command()
@click.option("--bodies", default=10, show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(bodies: int, output: Path) -> None:
    """Draw scans."""
    from matplotlib.figure import Figure

    lines = 2 * -(-bodies // COLUMNS)
    figure = Figure(figsize=(WIDTH, lines * WIDTH / COLUMNS), layout="constrained")
    places = figure.subplots(lines, COLUMNS, squeeze=False)
    for place in places.flat:
        place.set_axis_off()
    for number in range(bodies):
        made, random = WideBodies(seed=RANKED, poses=1).surfaces(number, 1), np.random.default_rng(number)
        body = Mesh(made.posed[0, 0], made.faces)
        scans = scan(body, height_of(made.canonical[0]), random).mesh, range_scan(body, random)
        pair = places[2 * (number // COLUMNS) :, number % COLUMNS]
        for place, mesh in zip(pair, (prepare(each).mesh for each in scans), strict=False):
            points = np.asarray(camera_coordinates(mesh, FRONT))
            place.imshow(np.asarray(painted(points, mesh.faces, None, SIZE, 1.05 * reach(points))))
    save(figure, output)


if __name__ == "__main__":
    main()

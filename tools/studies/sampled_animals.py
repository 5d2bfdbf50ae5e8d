"""``python -m tools.studies.sampled_animals -o FILE``: some of the animals that are sampled to train on.

Each row is one animal, in the rest pose and in some of its own, as the benchmark's camera sees it.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from benchmark.datasets.varied_animals import SPECIES_IN_TURN
from benchmark.geometry.depth import camera_coordinates
from benchmark.jobs.pairs.animals import made_body
from benchmark.report.pictures.forms import WIDTH, save
from benchmark.report.pictures.painting import painted
from benchmark.report.pictures.posing import reach

POSES = 3
SIZE = 240


@click.command()
@click.option("--animals", default=2, show_default=True, help="Of each species.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(animals: int, output: Path) -> None:
    """Draw sampled animals."""
    from matplotlib.figure import Figure

    lines, columns = len(SPECIES_IN_TURN), animals * (1 + POSES)
    figure = Figure(figsize=(WIDTH, WIDTH / columns * lines + 0.2), layout="constrained")
    places = figure.subplots(lines, columns, squeeze=False)
    for number in range(animals * lines):
        camera, meshes = made_body(2 * number + 1, 0)  # every other body is a person
        line, first = number % lines, number // lines * (1 + POSES)
        seen = [np.asarray(camera_coordinates(mesh, camera)) for mesh in meshes[: 1 + POSES]]
        for column, points in enumerate(seen):
            place = places[line, first + column]
            place.set_xticks([])
            place.set_yticks([])
            place.set_frame_on(False)
            place.imshow(np.asarray(painted(points, meshes[0].faces, None, SIZE, 1.05 * max(map(reach, seen)))))
        places[line, 0].set_ylabel(SPECIES_IN_TURN[line], fontsize=8)
    save(figure, output)


if __name__ == "__main__":
    main()

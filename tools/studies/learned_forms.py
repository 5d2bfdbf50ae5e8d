"""``python -m tools.studies.learned_forms -o FILE``: what the networks make of shapes that they have not seen.

Above each pair of pictures stands the shape, as its camera sees it and turned aside; below it the forms of each row,
by the model that has not seen the subject. From the front a network that has learned the mask looks right whatever
its depth is worth; from aside it does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from benchmark.api.contracts import Method
from benchmark.api.learning import Learner
from benchmark.datasets.catalogue import open_dataset
from benchmark.geometry.mesh import Mesh, Points
from benchmark.jobs.preparation import Preparation
from benchmark.methods.registry import methods, variant
from benchmark.protocols.trainings import trainings_by_shape
from benchmark.report.pictures.forms import WIDTH, save
from benchmark.report.pictures.painting import painted
from benchmark.report.pictures.posing import centred, reach

DATASET = "humans"
SHAPES = ("man-1_running", "child-2_dancing", "woman-3_thinking", "child-4_t-pose", "woman-5_star-jump")
ROWS = ("learned[jump=0.05]", "learned", "learned[smoothing=3]", "learned-wide-extra", "learned-streamed")

ASIDE = np.radians(60)
SIZE = 240


@click.command()
@click.option("-m", "--method", "names", multiple=True, default=ROWS, show_default=True)
@click.option("--shape", "shapes", multiple=True, default=SHAPES, show_default=True)
@click.option("-d", "--dataset", "set_name", default=DATASET, show_default=True)
@click.option("--data-root", type=click.Path(path_type=Path), help="The folder that holds the official sets.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(names: Sequence[str], shapes: Sequence[str], set_name: str, data_root: Path | None, output: Path) -> None:
    """Draw the forms of some shapes by networks."""
    from matplotlib.figure import Figure

    dataset = open_dataset(set_name, data_root)
    prepared = Preparation(dataset, "view")
    entries = [entry for entry in dataset.entries if entry.identifier in shapes]
    columns = [[prepared.shape(entry).mesh] for entry in entries]
    for name in names:
        spec = variant(name, methods())
        learner = spec.create()
        if not isinstance(learner, Learner):
            raise click.UsageError(f"{name} is no learner")
        trainings = trainings_by_shape(learner, dataset, entries, data_root)
        for entry, column in zip(entries, columns, strict=True):
            training = trainings[entry.identifier].name
            maker = spec.with_parameters({"training": training}).create()
            assert isinstance(maker, Method)
            form = maker.canonicalise(prepared.shape(entry))
            column.append(Mesh(form.vertices, form.faces))
    lines = len(names) + 1
    figure = Figure(figsize=(2 * WIDTH, 2 * WIDTH / (2 * len(entries)) * lines + 0.4), layout="constrained")
    places = figure.subplots(lines, 2 * len(entries), squeeze=False)
    for column, (entry, meshes) in enumerate(zip(entries, columns, strict=True)):
        for line, mesh in enumerate(meshes):
            points = centred(mesh.vertices)
            for side, shown in enumerate((points, aside(points))):
                place = places[line, 2 * column + side]
                place.set_xticks([])
                place.set_yticks([])
                place.set_frame_on(False)
                place.imshow(np.asarray(painted(shown, mesh.faces, None, SIZE, 1.05 * reach(points))))
        places[0, 2 * column].set_title(entry.identifier.replace("_", "\n"), fontsize=8)
    for line, name in enumerate(("input", *names)):
        places[line, 0].set_ylabel(name.replace("[", "\n["), fontsize=7)
    save(figure, output)


def aside(points: Points) -> Points:
    """Points turned about the vertical axis of the picture, shape (n, 3)."""
    sine, cosine = np.sin(ASIDE), np.cos(ASIDE)
    return np.asarray(points @ np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]]))


if __name__ == "__main__":
    main()

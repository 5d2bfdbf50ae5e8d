"""``python -m tools.studies.worst_forms METHOD GALLERY... -o FILE``: the forms by which retrieval failed most.

Of all shapes of the galleries those with the lowest DCG: the shape, its form, and the form that was found nearest.
They are those of a finished run, which has the method and ``identity``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np
import pandas as pd

from benchmark.geometry.camera import FRONT
from benchmark.geometry.mesh import Mesh
from benchmark.report.pictures.forms import WIDTH, save
from benchmark.report.pictures.painting import painted
from benchmark.report.pictures.posing import centred, reach, upright
from benchmark.results import ResultsFolder, open_results
from retrieval.measures import PRINTED
from tools.studies.finished import newest

SIZE = 240


@click.command()
@click.argument("method")
@click.argument("galleries", nargs=-1, required=True)
@click.option("--input", "input_", type=click.Choice(["mesh", "view"]), default="view", show_default=True)
@click.option("--results", default="results", show_default=True, help="Where the run is.")
@click.option("--count", type=click.IntRange(1), default=10, show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(method: str, galleries: tuple[str, ...], input_: str, results: str, count: int, output: Path) -> None:
    """Draw the worst forms of METHOD in GALLERIES."""
    folder = open_results(results)
    found = [(name, key, queries(folder, key)) for name in galleries for key in [newest(folder, name, method, input_)]]
    ordered = pd.concat(each.assign(gallery=name, key=key) for name, key, each in found).sort_values("DCG").head(count)
    draw(folder, ordered, input_, output)
    print(ordered[["gallery", *PRINTED]].to_string())


def queries(folder: ResultsFolder, key: str) -> pd.DataFrame:
    """Measures of all shapes of a job, by shape."""
    return folder.queries(key).reset_index().set_index("shape")


def draw(folder: ResultsFolder, chosen: pd.DataFrame, input_: str, output: Path) -> None:
    """Draw shapes, forms and the forms that were found nearest."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2 * WIDTH, 2 * WIDTH / len(chosen) * 3 + 0.6), layout="constrained")
    places = figure.subplots(3, len(chosen), squeeze=False)
    jobs = chosen.drop_duplicates("key")
    forms_of = {key: folder.forms(key) for key in jobs["key"]}
    distances_of = {key: folder.distances(key) for key in jobs["key"]}
    surfaces_of = {name: folder.forms(newest(folder, name, "identity", input_)) for name in jobs["gallery"]}
    for column, (name, row) in enumerate(chosen.iterrows()):
        forms, surfaces = forms_of[row["key"]], surfaces_of[row["gallery"]]
        nearest = distances_of[row["key"]].loc[name].drop(name).idxmin()
        shown = [seen(surfaces[name], input_), *(turned(forms, surfaces, each, input_) for each in (name, nearest))]
        for line, mesh in enumerate(shown):
            place = places[line, column]
            place.set_axis_off()
            points = centred(mesh.vertices)
            place.imshow(np.asarray(painted(points, mesh.faces, None, SIZE, 1.05 * reach(points))))
            if line != 1:
                place.set_title(str(name if not line else nearest).replace("_", "\n"), fontsize=8)
    save(figure, output)


def seen(mesh: Mesh, input_: str) -> Mesh:
    """A surface as its camera sees it: to the right, up, towards the viewer."""
    return mesh if input_ == "view" else mesh.with_vertices(mesh.vertices @ FRONT.rotation.T)


def turned(forms: Mapping[str, Mesh], surfaces: Mapping[str, Mesh], name: str, input_: str) -> Mesh:
    """A form turned like its shape, where it has the same triangles."""
    form = forms[name]
    return form.with_vertices(upright(form, surfaces[name], seen(surfaces[name], input_).vertices, None))


if __name__ == "__main__":
    main()

"""``python -m tools.studies.field_scans [FOLDER]``: whether the field finds people again in scans of another kind.

20 validation bodies in five poses each are scanned by :mod:`tools.studies.range_scanning`, which no training sees, and
prepared as in a comparison. They are ranked by the forms of the field whose model is in FOLDER (the shipped one if none
is named; of a training that has not ended its newest weights), and by some rows of the tables. No subject of any set
that methods are tested on is looked at. Writes ``results/field-scans.json``. Scans, and what is seen of the forms, are
kept in ``build/field-scans``: a run that was stopped goes on where it was, and another model costs its own forms alone.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import functools  # noqa: E402
import hashlib  # noqa: E402
import json  # noqa: E402
from collections.abc import Callable, Mapping, Sequence  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
from safetensors import safe_open  # noqa: E402
from safetensors.torch import save  # noqa: E402

from baselines.classic_mds import ClassicMDS  # noqa: E402
from baselines.gps import GPS  # noqa: E402
from baselines.wks_mean import MeanWKS  # noqa: E402
from benchmark.api.contracts import Shape  # noqa: E402
from benchmark.api.learning import CARD, WEIGHTS, read_card  # noqa: E402
from benchmark.api.streaming import MakesSurfaces, Surfaces  # noqa: E402
from benchmark.datasets.scans.bodies import WideBodies  # noqa: E402
from benchmark.errors import UnsupportedShape  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.jobs.stages.distances import descriptor_distances, form_distances  # noqa: E402
from benchmark.jobs.stages.measures import scores  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.system.files import write_atomically, write_text  # noqa: E402
from learned.field.methods import DeformationField  # noqa: E402
from learned.field.model import configuration_of  # noqa: E402
from learned.training.checkpoint import SNAPSHOTS  # noqa: E402
from retrieval.cmbof import CMBOF  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.field_detail import RANKED  # noqa: E402
from tools.studies.people import interval, keep_newest  # noqa: E402
from tools.studies.range_scanning import range_scan  # noqa: E402

BODIES, POSES = 20, 5
KEPT = Path("build/field-scans")
FIGURES = Path("results/field-scans.json")

Arrays = dict[str, np.ndarray]
Row = dict[str, Any]


@click.command()
@click.argument("folder", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--bodies", type=click.IntRange(2), default=BODIES, show_default=True, help="Bodies that are ranked.")
def main(folder: Path | None, bodies: int) -> None:
    """Rank what is not ranked yet, and print all rows."""
    field = DeformationField()
    if folder:
        folder = folder if (folder / CARD).is_file() else unfinished(folder, KEPT)
        field = DeformationField(configuration=configuration_of(read_card(folder), folder).name).load(folder)
    shapes, subjects = gallery(WideBodies(seed=RANKED, poses=POSES).surfaces, bodies, KEPT)
    compare((field, MeanWKS(), GPS(), ClassicMDS()), shapes, subjects, KEPT, FIGURES)
    print(table(json.loads(FIGURES.read_text())))


def unfinished(training: Path, kept: Path) -> Path:
    """Folder of a model with the newest weights of a training that has not ended, as half precision stores them."""
    keep_newest(training)
    path = max((training / SNAPSHOTS).glob("*.safetensors"))
    with safe_open(str(path), framework="pt") as file:
        told = file.metadata()
        content = save({name: file.get_tensor(name) for name in file.keys()})  # noqa: SIM118
    seen = [f"{told['bodies']} bodies of a training that has not ended"]
    card = {
        "digest": hashlib.sha256(content).hexdigest(),
        "field": json.loads(told["recipe"])["configuration"],
        "data": DeformationField.default_training,
        "subjects": seen,
        "identifiers": seen,
    }
    folder = kept / "models" / path.stem
    write_atomically(folder / WEIGHTS, lambda file: file.write(content))
    write_text(folder / CARD, json.dumps(card))
    return folder


def gallery(make: MakesSurfaces, bodies: int, folder: Path) -> tuple[list[Shape], list[str]]:
    """Scans of all poses of some bodies, prepared as in a comparison, and whose they are."""
    shapes, subjects = [], []
    for number in range(bodies):
        drawn = functools.cache(partial(make, number, 1))
        for pose in range(POSES):
            kept = _kept(folder / "shapes" / f"{number}-{pose}.npz", partial(_scanned, drawn, number, pose))
            shapes.append(Shape(identifier=f"{number}-{pose}", mesh=Mesh(kept["vertices"], kept["faces"])))
            subjects.append(str(number))
    return shapes, subjects


def _scanned(drawn: Callable[[], Surfaces], number: int, pose: int) -> Arrays:
    body = Mesh(drawn().posed[0, pose], drawn().faces)
    mesh = prepare(range_scan(body, np.random.default_rng([RANKED, number, pose, 4]))).mesh
    return {"vertices": mesh.vertices, "faces": mesh.faces}


def compare(
    methods: Sequence[Any], shapes: Sequence[Shape], subjects: Sequence[str], folder: Path, figures: Path
) -> None:
    """Append a row for each method that has none for these shapes.

    Parameters
    ----------
    methods
        Methods with their models.
    shapes, subjects
        The gallery.
    folder
        Where signatures are kept.
    figures
        Where rows are kept.
    """
    scans = hashlib.sha256(b"".join(each.mesh.vertices.tobytes() for each in shapes)).hexdigest()[:16]
    found: list[Row] = json.loads(figures.read_text()) if figures.is_file() else []
    found = [row for row in found if row["scans"] == scans]
    for method in methods:
        name = _name(method)
        if any(row["method"] == name for row in found):
            continue
        row = _measured(method, shapes, subjects, folder / scans / name)
        found.append({"method": name, "title": method.info.title, "scans": scans, **row})
        write_text(figures, json.dumps(found, indent=1) + "\n")
        print({name: value for name, value in row.items() if name in PRINTED}, flush=True)


def _name(method: Any) -> str:
    """Name of a method, with the beginning of its model's digest."""
    if not hasattr(method, "model_folder"):
        return str(method.info.name)
    return f"{method.info.name}-{read_card(method.model_folder)['digest'][:12]}"


def _measured(method: Any, shapes: Sequence[Shape], subjects: Sequence[str], folder: Path) -> Row:
    """Scores of a method with their intervals over bodies; a shape that is refused finds nothing."""
    scorer, describes, seen, answered = CMBOF(), hasattr(method, "describe"), [], []

    def made(shape: Shape) -> Arrays:
        if describes:
            return {"descriptor": method.describe(shape)}
        return dict(scorer.signature(method.canonicalise(shape).mesh))

    for place, shape in enumerate(shapes):
        try:
            seen.append(_kept(folder / f"{shape.identifier}.npz", partial(made, shape)))
        except UnsupportedShape:
            continue
        answered.append(place)
    if describes:
        matrices = iter([descriptor_distances(method, [each["descriptor"] for each in seen])])
    else:
        matrices = (form_distances(scorer, seen, draw) for draw in range(scorer.info.draws))
    ranked = scores(matrices, subjects, answered)
    row: Row = {"shapes": len(shapes), "refused": len(shapes) - len(answered)}
    names = list(dict.fromkeys(subjects))
    for name in PRINTED:
        values = np.array([value or 0.0 for value in ranked["per_query"][name]])
        of_body = [float(values[[subject == each for subject in subjects]].mean()) for each in names]
        row |= {name: round(float(np.mean(of_body)), 4), f"{name} interval": [round(x, 4) for x in interval(of_body)]}
        row[f"chance {name}"] = round(ranked["chance"][name], 4)
    return row


def _kept(path: Path, make: Callable[[], Mapping[str, np.ndarray]]) -> Arrays:
    """Arrays of a file, which are made if it is not there."""
    if not path.is_file():
        write_atomically(path, partial(np.savez, **make()))
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)


def table(found: Sequence[Row]) -> str:
    """The comparison as Markdown, for ``docs/appendix/deformation-field.md``."""
    body = []
    for row in found:
        intervals = (" to ".join(f"{end:.2f}" for end in row[f"{name} interval"]) for name in ("NN", "FT"))
        body.append([f"`{row['method']}`", *(f"{row[name]:.2f}" for name in PRINTED), *intervals])
    if found:
        body.append(["*chance*", *(f"{found[0][f'chance {name}']:.2f}" for name in PRINTED), "", ""])
    return "\n".join(markdown_table(["method", *PRINTED, "95 % of NN", "95 % of FT"], body))


if __name__ == "__main__":
    main()

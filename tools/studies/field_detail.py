"""``python -m tools.studies.field_detail FOLDER``: how much detail a form of the field takes from its input.

The forms of validation bodies, which are a stream of their own, are ranked against each other for each ``reach`` and
number of ``rounds``. No subject of any set that methods are tested on is looked at. Writes
``results/field-detail.json``; a run that was stopped goes on where it was, and another model begins anew.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Iterable, Mapping, Sequence  # noqa: E402
from dataclasses import replace  # noqa: E402
from pathlib import Path  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402

from baselines.identity import Identity  # noqa: E402
from benchmark.api.contracts import Shape  # noqa: E402
from benchmark.api.learning import read_card  # noqa: E402
from benchmark.api.streaming import Surfaces  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from learned.field.methods import DeformationField  # noqa: E402
from learned.field.model import configuration_of as field_in  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.learning_curve import ranked  # noqa: E402

#: Seed of the bodies that are ranked, neither trained on nor looked at while training.
RANKED = 2
BODIES, POSES = 20, 5

REACHES = (0.0, 0.03, 0.1, 0.3, 1.0)
ROUNDS = (0, 3)

FIGURES = Path("results/field-detail.json")

Row = dict[str, float | str]


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--bodies", type=click.IntRange(2), default=BODIES, show_default=True, help="Bodies that are ranked.")
def main(folder: Path, bodies: int) -> None:
    """Rank forms of the model in FOLDER."""
    chosen = DeformationField(configuration=field_in(read_card(folder), folder).name).load(folder)
    compare(chosen, Sampler(RANKED, poses=POSES).surfaces(0, bodies), FIGURES)
    print(table(json.loads(FIGURES.read_text())))


def compare(method: DeformationField, bodies: Surfaces, figures: Path) -> None:
    """Measure what is missing in the figures: the input as it is, the bare prediction, and each setting.

    Parameters
    ----------
    method
        The field, with its model.
    bodies
        What is ranked.
    figures
        Where rows are kept.
    """
    model = str(read_card(method.model_folder)["digest"])
    asked = {"model": model, "bodies": len(bodies.identifiers)}
    found: list[Row] = json.loads(figures.read_text()) if figures.is_file() else []
    found = [row for row in found if {name: row[name] for name in asked} == asked]
    shapes, subjects = _prepared(bodies)
    settings = [(reach, rounds) for reach in REACHES for rounds in (ROUNDS if reach else ROUNDS[:1])]
    for form, one in (
        ("input", Identity()),
        *(
            (f"reach {a:g}, rounds {b}", replace(method, reach=a, rounds=b).load(method.model_folder))
            for a, b in settings
        ),
    ):
        if any(row["form"] == form for row in found):
            continue
        forms = [one.canonicalise(shape) for shape in shapes]
        strain = np.mean([float(each.notes.get("edge_strain", 0.0)) for each in forms])
        scores = ranked((Mesh(each.vertices, each.faces) for each in forms), subjects)
        row = {"edge strain": float(strain), **scores}
        found.append({"form": form, **asked, **{name: round(value, 4) for name, value in row.items()}})
        figures.parent.mkdir(exist_ok=True)
        figures.write_text(json.dumps(found, indent=1) + "\n")
        print(found[-1], flush=True)


def _prepared(bodies: Surfaces) -> tuple[list[Shape], list[str]]:
    """All poses of all bodies, prepared as in a comparison, and whose they are."""
    shapes, subjects = [], []
    for name, of_body in zip(bodies.identifiers, bodies.posed, strict=True):
        for number, vertices in enumerate(of_body):
            identifier = f"{name}-{number}"
            shapes.append(Shape(identifier=identifier, mesh=prepare(Mesh(vertices, bodies.faces)).mesh))
            subjects.append(name)
    return shapes, subjects


def table(found: Sequence[Mapping[str, float | str]]) -> str:
    """The comparison as Markdown, for ``docs/appendix/deformation-field.md``."""
    body = [[f"{row['form']}", *_cells(row, PRINTED), f"{row['edge strain']:.3f}"] for row in found]
    if found:
        body.append(["*chance*", *_cells(found[0], [f"chance {name}" for name in PRINTED]), ""])
    return "\n".join(markdown_table(["form", *PRINTED, "change of lengths"], body))


def _cells(row: Mapping[str, float | str], names: Iterable[str]) -> list[str]:
    return [f"{row[name]:.2f}" for name in names]


if __name__ == "__main__":
    main()

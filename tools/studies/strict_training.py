"""``python -m tools.studies.strict_training``: why the strict row of Table IV is lower; writes ``results/strict.json``.

The strict row differs from the row "Our" in two respects. No model has seen a pose that it is tested on; and the twenty
forms of a subject come from four models, which differ as any two trainings do. What the second costs shows where half
of the forms of "Our" are taken from another training on the same data; what the first costs shows in galleries of five
poses, all of whose forms come from one model. Forms are those of a finished ``run -t IV``.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Callable, Iterable, Mapping, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import NamedTuple  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402

from benchmark.datasets.human_poses import POSES  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.protocols.trainings import POSE_FOLDS, SUBJECT_FOLDS  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.results import ResultsFolder, open_results  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.finished import newest  # noqa: E402
from tools.studies.learning_curve import ranked  # noqa: E402

FIGURES = Path("results/strict.json")

WHOLE = tuple(range(len(POSES)))

#: Rows by name: which training makes the form of a pose fold, and which poses are one gallery.
ROWS: dict[str, tuple[Callable[[int], str], tuple[tuple[int, ...], ...]]] = {
    "all poses, one model that saw them": (lambda fold: "learned", (WHOLE,)),
    "all poses, two models that saw them": (lambda fold: ("learned", "learned[training_seed=1]")[fold % 2], (WHOLE,)),
    "all poses, four models that saw others (strict)": (lambda fold: "learned-strict", (WHOLE,)),
    "five poses, one model that saw them": (lambda fold: "learned", POSE_FOLDS),
    "five poses, one model that saw others (strict)": (lambda fold: "learned-strict", POSE_FOLDS),
}

Row = dict[str, float | str]


class Form(NamedTuple):
    """A form, and what it is of."""

    subject: str
    pose: int
    mesh: Mesh


@click.command()
@click.option("--results", default="results", show_default=True, help="Where the run is.")
def main(results: str) -> None:
    """Rank what the models of Table IV made in other galleries."""
    folder = open_results(results)
    forms = {name: [_forms(folder, name, fold) for fold in range(len(SUBJECT_FOLDS))] for name in _trainings()}
    found = [compared(name, forms) for name in ROWS]
    FIGURES.parent.mkdir(exist_ok=True)
    FIGURES.write_text(json.dumps(found, indent=1) + "\n")
    print(table(found))


def _trainings() -> list[str]:
    return sorted({row(fold) for row, _ in ROWS.values() for fold in range(len(POSE_FOLDS))})


def _forms(folder: ResultsFolder, method: str, fold: int) -> list[Form]:
    """Forms of a fold of the generated humans; they are named by subject and pose."""
    kept = folder.forms(newest(folder, f"humans fold {fold}", method, "view"))
    return [Form(*_split_name(name), mesh) for name, mesh in kept.items()]


def _split_name(name: str) -> tuple[str, int]:
    subject, _, pose = name.partition("_")
    return subject, list(POSES).index(pose)


def compared(name: str, forms: Mapping[str, Sequence[Sequence[Form]]]) -> Row:
    """Mean scores over the galleries of a row of :data:`ROWS`.

    Parameters
    ----------
    name
        The row.
    forms
        By training, for each fold of subjects.
    """
    training_of, galleries = ROWS[name]
    found = []
    for fold in range(len(SUBJECT_FOLDS)):
        by_place = {(f.subject, f.pose): f for number, poses in enumerate(POSE_FOLDS)
                    for f in forms[training_of(number)][fold] if f.pose in poses}  # fmt: skip
        for poses in galleries:
            chosen = [each for each in by_place.values() if each.pose in poses]
            found.append(ranked((each.mesh for each in chosen), [each.subject for each in chosen]))
    return {"row": name, "galleries": len(found), **_means(found)}


def _means(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {name: round(float(np.mean([each[name] for each in found])), 4) for name in found[0]}


def table(found: Iterable[Mapping[str, float | str]]) -> str:
    """The comparison as Markdown, for ``docs/appendix/paper-network.md``."""
    names = (*PRINTED, "chance NN")
    body = [[f"{row['row']}", *(f"{row[name]:.2f}" for name in names)] for row in found]
    return "\n".join(markdown_table(["gallery and models", *names], body))


if __name__ == "__main__":
    main()

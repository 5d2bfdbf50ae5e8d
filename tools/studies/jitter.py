"""``python -m tools.studies.jitter RESULTS``: at which stage a jitter of a millionth becomes a jump.

Reads a results folder of ``run ... --repeat N`` and compares each clean row with its jittered preparations, stage by
stage: prepared shape, geodesics, form, pose of the signature, distances, scores. Nothing of a run is made again but
some rows of geodesic distances and the poses; a run that was stopped goes on where it was, and so does this::

    python -m benchmark run -t III --quick --input mesh -m classic-mds -m gps --repeat 5 --results build/jitter
    python -m tools.studies.jitter build/jitter
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import statistics  # noqa: E402
from collections.abc import Iterable, Iterator  # noqa: E402
from dataclasses import dataclass, fields  # noqa: E402
from pathlib import Path  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402

from baselines._kernels.orientation import vertex_areas  # noqa: E402
from benchmark.api.contracts import FloatArray, Mesh, Shape  # noqa: E402
from benchmark.datasets.base import Entry  # noqa: E402
from benchmark.jobs.preparation import Preparation  # noqa: E402
from benchmark.methods.registry import methods  # noqa: E402
from benchmark.report.artefact_reader import ArtefactReader  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.report.results import Result, Results  # noqa: E402
from benchmark.storage.records import Record, scorer_name  # noqa: E402
from benchmark.storage.store import Store  # noqa: E402
from retrieval.cmbof import CMBOF  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from retrieval.pose import normalise  # noqa: E402

SOURCES = 5
"""Vertices from which geodesic distances are compared."""

JUMP = 15.0
"""Degrees by which two poses differ that are two; the search for one ends far below."""


@dataclass(frozen=True)
class Change:
    """What a jitter changed of one shape; means over vertices, in roots of the area before and after.

    Parameters
    ----------
    prepared
        Distance from a vertex to the nearest one of the clean shape.
    geodesics
        Difference of geodesic distances between such neighbours, over the mean distance.
    form
        Distance of such neighbours in the form, after alignment without a mirror, over the radius of gyration.
    mirrored
        Whether the form fits better in a mirror.
    pose
        Whether the scorer looks at it in another pose, up to the 24 rotations of the cube.
    """

    prepared: float
    geodesics: float
    form: float
    mirrored: float
    pose: float


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--data-root", type=click.Path(path_type=Path), envvar="CANONICAL_FORMS_DATA")
@click.option("--shapes", type=click.IntRange(1), default=10, show_default=True, help="Shapes that are compared.")
def main(folder: Path, data_root: Path | None, shapes: int) -> None:
    """Print what jitter changes of each row with repeats, stage by stage, as Markdown."""
    store, known = Store.open(folder), methods()
    artefacts = ArtefactReader(store, known, data_root)
    rows = [result for result in Results(store, known, data_root).all() if len(result.repeats) > 1]
    head = ("gallery", "input", "method", "shapes", *(field.name for field in fields(Change)), "matrix", "same NN")
    print("\n".join(markdown_table(head, [stages(result, artefacts, shapes) for result in rows], 3)) + "\n", flush=True)
    measured = ("gallery", "input", "method", "jitters", *PRINTED, *(f"sd {name}" for name in PRINTED))
    print("\n".join(markdown_table(measured, map(scores, rows), 3)))


def scores(result: Result) -> list[str]:
    """Return the cells of a row: clean scores, and the standard deviation over clean and jittered preparations."""
    all_scores = [each["scores"] for each in (result.record, *result.repeats.values())]
    spread = [statistics.stdev(each[name] for each in all_scores) for name in PRINTED]
    return [
        *_place(result), f"{len(result.repeats)}",
        *(f"{all_scores[0][name]:.3f}" for name in PRINTED), *(f"{each:.3f}" for each in spread),
    ]  # fmt: skip


def stages(result: Result, artefacts: ArtefactReader, shapes: int) -> list[str]:
    """Return the cells of a row: medians over shapes and jitters, and the largest in brackets; shares of jumps."""
    record = result.record
    wanted = record["shapes"][:: max(1, len(record["shapes"]) // shapes)]
    found = [change for other in result.repeats.values() for change in changes(record, other, artefacts, wanted)]
    cells = [_place(result), [f"{len(wanted)}"]]
    for name in ("prepared", "geodesics", "form"):
        values = [getattr(change, name) for change in found]
        cells.append([f"{np.nanmedian(values):.4f} ({np.nanmax(values):.3f})" if values else "--"])
    cells += [[_mean(getattr(change, name) for change in found)] for name in ("mirrored", "pose")]
    matrices = [compared_distances(record, other, artefacts) for other in result.repeats.values()]
    cells += [[_mean(each[k] for each in matrices if each)] for k in range(2)]
    return [cell for part in cells for cell in part]


def changes(clean: Record, jittered: Record, artefacts: ArtefactReader, shapes: Iterable[str]) -> Iterator[Change]:
    """Compare the shapes of two records that are kept in both."""
    places = [(artefacts.preparation(record), _entries(artefacts.preparation(record))) for record in (clean, jittered)]
    for name in shapes:
        forms = [artefacts.form(record, of[name]) for record, (_, of) in zip((clean, jittered), places, strict=True)]
        if not isinstance(forms[0], str) and not isinstance(forms[1], str):
            yield compared(*(each.shape(of[name]) for each, of in places), *forms)


def compared(clean: Shape, jittered: Shape, form: Mesh, other: Mesh) -> Change:
    """Compare two shapes and their forms; vertices of the jittered shape stand beside the nearest of the clean one."""
    apart, nearest = cKDTree(clean.mesh.vertices).query(jittered.mesh.vertices)
    weights = vertex_areas(jittered.mesh)
    weights /= weights.sum()
    if len(other.vertices) != len(nearest) or len(form.vertices) != clean.mesh.n_vertices:
        return Change(float(weights @ apart), compared_geodesics(clean, jittered, nearest), np.nan, np.nan, np.nan)
    here, there = form.vertices[nearest], other.vertices
    _, distance, mirrored = aligned(here, there, weights)
    return Change(
        float(weights @ apart),
        compared_geodesics(clean, jittered, nearest),
        distance,
        float(mirrored),
        float(np.nan if mirrored else is_another_pose(form, other, here, there, weights)),
    )


def compared_geodesics(clean: Shape, jittered: Shape, nearest: np.ndarray) -> float:
    """Mean difference of geodesic distances from some vertices, over the mean distance."""
    sources = np.linspace(0, jittered.mesh.n_vertices - 1, SOURCES).astype(int)
    here = clean.geodesics_from(nearest[sources])[:, nearest]
    return float(np.abs(here - jittered.geodesics_from(sources)).mean() / here.mean())


def aligned(here: FloatArray, there: FloatArray, weights: FloatArray) -> tuple[FloatArray, float, bool]:
    """Rotate points onto others: the rotation, the distance over the radius of gyration, whether a mirror fits better.

    Forms without a size of their own are compared as they are.
    """
    here, there = here - weights @ here, there - weights @ there
    left, _, right = np.linalg.svd((here * weights[:, None]).T @ there)
    mirrored = bool(np.linalg.det(left @ right) < 0)
    if mirrored:
        left[:, 2] *= -1
    rotation = left @ right
    rest = np.sqrt(weights @ ((here @ rotation - there) ** 2).sum(axis=1))
    return rotation, float(rest / np.sqrt(weights @ (there**2).sum(axis=1))), mirrored


def is_another_pose(form: Mesh, other: Mesh, here: FloatArray, there: FloatArray, weights: FloatArray) -> bool:
    """Return whether the scorer turns two nearly equal forms differently, by more than a symmetry of the cube."""
    scorer = CMBOF()
    turns = []
    for mesh, points in ((form, form.vertices), (other, other.vertices)):
        upright = normalise(mesh, scorer.pose, scorer.image_size).vertices
        turns.append(aligned(points, upright, np.full(len(points), 1 / len(points)))[0])
    between = turns[0].T @ aligned(here, there, weights)[0] @ turns[1]
    # The nearest rotation of the cube has the largest sum of entries in three places.
    cosine = (max(float((between * cube).sum()) for cube in _cube()) - 1) / 2
    return bool(np.degrees(np.arccos(np.clip(cosine, -1, 1))) > JUMP)


def _cube() -> Iterator[FloatArray]:
    """The 24 rotations of the cube."""
    for order in np.ndindex(3, 3, 3):
        if len(set(order)) == 3:
            for signs in np.ndindex(2, 2, 2):
                found = np.eye(3)[list(order)] * (1 - 2 * np.array(signs))[:, None]
                if np.linalg.det(found) > 0:
                    yield found


def compared_distances(clean: Record, jittered: Record, artefacts: ArtefactReader) -> tuple[float, float] | None:
    """Mean change of the distances over their mean, and the share of queries with the nearest neighbour of before."""
    here, there = (np.stack(list(artefacts.distances(record)) or [np.empty((0, 0))]) for record in (clean, jittered))
    if here.shape != there.shape or not here.size:
        return None
    here, there = here.mean(axis=0).astype(float), there.mean(axis=0).astype(float)
    off = ~np.eye(len(here), dtype=bool)
    change = np.abs(here - there)[off].mean() / here[off].mean()
    for matrix in (here, there):
        np.fill_diagonal(matrix, np.inf)
    return float(change), float((here.argmin(axis=1) == there.argmin(axis=1)).mean())


def _entries(preparation: Preparation) -> dict[str, Entry]:
    return {entry.identifier: entry for entry in preparation.dataset.entries}


def _place(result: Result) -> list[str]:
    record = result.record
    by = scorer_name(record)
    return [record["gallery"], record["input"], record["method"] + (f" by {by}" if by not in ("", "cm-bof") else "")]


def _mean(values: Iterable[float]) -> str:
    known = [value for value in values if not np.isnan(value)]
    return f"{np.mean(known):.3f}" if known else "--"


if __name__ == "__main__":
    main()

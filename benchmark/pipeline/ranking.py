"""Rank a gallery: its distances from the cached signatures, and the content of its record."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.scoring import Scorer
from benchmark.pipeline.stages import MACHINE, NOTE, REFUSED, SECONDS, Arrays, clock
from retrieval.measures import score_draws

if TYPE_CHECKING:
    from benchmark.api.contracts import Descriptor
    from benchmark.pipeline.cache import Cache, Stage
    from benchmark.pipeline.records import RankedShapes, Record

#: Returns what a scorer or descriptor returned as a matrix of a shape, or raises an error that names
#: it; see :func:`benchmark.pipeline.outputs.make_distance_check`.
Check = Callable[[object, tuple[int, int]], NDArray[np.float64]]

#: Arrays of prepared shapes and forms that ranking does not read.
_SURFACES = ("vertices", "faces", "depth")

#: Names in records of the stages that make the files.
STAGES: Mapping[Stage, str] = {
    "prepared": "prepare",
    "forms": "canonicalise",
    "signatures": "signature",
    "records": "ranking",
}


class DamagedFiles(Exception):
    """Cached files that are missing or damaged.

    Parameters
    ----------
    files
        Stage and key of each.
    """

    def __init__(self, files: Sequence[tuple[Stage, str]]) -> None:
        super().__init__(files)
        self.files = files


def rank(
    record: Record, cache: Cache, comparing: Descriptor | Scorer, check: Check
) -> tuple[dict[str, Any], Arrays]:
    """Rank a gallery whose shapes have all been processed.

    Parameters
    ----------
    record
        The record of the job without its outcome: shapes, classes and keys of their files.
    cache
        The cached files.
    comparing
        The scorer, or the descriptor that compares its own vectors.
    check
        Checks each of its matrices.

    Returns
    -------
    dict
        What the record says of the outcome.
    dict
        ``distances`` of the answered queries to the answered shapes, means over the draws; empty if
        there are none.

    Raises
    ------
    DamagedFiles
        If files of a shape are missing or damaged.
    """
    start = clock()
    sides = [_read(side, cache) for side in record.sides]
    (answered, refused), (in_gallery, refused_there) = sides[0], sides[-1]
    if not (answered and in_gallery):
        return refused_there if answered else refused, {}
    queries, gallery = (
        [[*stages.values()][-1] for stages in of.values()] for of in (answered, in_gallery)
    )
    other = record.gallery_of_queries
    matrices = distances(comparing, check, gallery, queries if other else None)
    shown, first = np.unique(np.array([*in_gallery]) // record.sides[-1].views, return_index=True)
    if len(shown) < len(gallery):
        matrices = (np.minimum.reduceat(matrix, first, axis=1) for matrix in matrices)
    total, draws = np.zeros((len(queries), len(shown))), 0

    def summed() -> Iterator[NDArray[np.float64]]:
        nonlocal draws
        for matrix in matrices:
            np.add(total, matrix, out=total)
            draws += 1
            yield matrix

    targets = record.targets and replace(record.targets, answered=shown.tolist())
    content = {
        **score_draws(summed(), record.labels, [*answered], targets),
        **refused,
        **({"against": msgspec.to_builtins(other) | refused_there} if other else {}),
        "notes": _summarise_notes(answered.values()),
        "machines": sorted(
            {str(of[MACHINE]) for stages in answered.values() if MACHINE in (of := stages["forms"])}
        ),
    }
    spent = _median_seconds(list(answered.values())) | {
        STAGES["records"]: (clock() - start) / len(record.shapes)
    }
    for place, name in enumerate(("seconds", "processor_seconds")):
        content[name] = {stage: round(float(of[place]), 4) for stage, of in spent.items()}
    return content, {"distances": total / draws}


def _read(
    side: RankedShapes, cache: Cache
) -> tuple[dict[int, dict[Stage, Arrays]], dict[str, Any]]:
    """Return the stages of the shapes with a result by index, and what a record says of the others."""
    answered: dict[int, dict[Stage, Arrays]] = {}
    reasons: dict[int, tuple[Stage, str]] = {}
    damaged: list[tuple[Stage, str]] = []
    for index, keys in enumerate(side.keys):
        stages: dict[Stage, Arrays] = {}
        for stage, key in keys.items():  # up to the one that refuses the shape
            arrays = cache.read(stage, key, without=() if stage == "signatures" else _SURFACES)
            if arrays is None:
                damaged.append((stage, key))
                continue
            stages[stage] = arrays
            if REFUSED in arrays:
                reasons[index] = stage, "; ".join(filter(None, arrays[REFUSED].tolist()))
                break
        else:
            answered[index] = stages
    if damaged:
        raise DamagedFiles(damaged)
    shown = {index // side.views for index in answered}
    refused = [
        (shape, *reasons[k * side.views]) for k, shape in enumerate(side.shapes) if k not in shown
    ]
    return answered, {
        "unsupported": [(shape, reason) for shape, _, reason in refused],
        "unprepared": [shape for shape, stage, _ in refused if stage == "prepared"],
    }


def distances(
    comparing: Descriptor | Scorer,
    check: Check,
    answers: Sequence[Arrays],
    queries: Sequence[Arrays] | None = None,
) -> Iterator[NDArray[np.float64]]:
    """Yield the distances of signatures for each draw of their scorer; of a descriptor, those of its vectors.

    Queries are compared with the answers; without queries, the answers are.
    """
    is_scorer = isinstance(comparing, Scorer)

    def compared(arrays: Arrays) -> Any:
        return (
            {name: of for name, of in arrays.items() if name != SECONDS}
            if is_scorer
            else arrays["descriptor"]
        )

    of_gallery, of_queries = (
        [*map(compared, answers)],
        None if queries is None else [*map(compared, queries)],
    )
    if of_queries is None and len(answers) == 1:
        yield np.zeros((1, 1))
        return
    for draw in range(comparing.info.draws if isinstance(comparing, Scorer) else 1):
        yield distances_of_draw(comparing, check, of_gallery, draw, of_queries)


def distances_of_draw(
    comparing: Descriptor | Scorer,
    check: Check,
    outputs: Sequence[Any],
    draw: int = 0,
    queries: Sequence[Any] | None = None,
) -> NDArray[np.float64]:
    """Return the dissimilarities of all pairs of descriptors, or of signatures for one draw of their scorer.

    Those of queries to the outputs, shape (M, N), depend on no other query.
    """
    given = _given(outputs)
    if queries is None:
        matrix = (
            comparing.compare(given, draw)
            if isinstance(comparing, Scorer)
            else comparing.distances(given)
        )
        return check(matrix, (len(given), len(given)))
    if compare_to := getattr(comparing, "compare_to", None):
        return check(compare_to(_given(queries), given, draw), (len(queries), len(given)))
    rows = []
    for query in queries:
        matrix = distances_of_draw(comparing, check, [*outputs, query], draw)
        rows.append(matrix[-1, :-1].copy())  # a view would keep its matrix
    return np.stack(rows)


def _given(outputs: Sequence[Any]) -> tuple[Any, ...]:
    """Return vectors or signatures as a component gets them: what it changes in them reaches no other draw."""
    return tuple(dict(of) if isinstance(of, Mapping) else of for of in outputs)


def _summarise_notes(answered: Iterable[Mapping[Stage, Arrays]]) -> dict[str, dict[str, float]]:
    """Return the mean and the maximum of each number that preparation or method reported."""
    notes = defaultdict[str, list[float]](list)
    for stages in answered:
        for name, note in {**stages["prepared"], **stages["forms"]}.items():
            if name.startswith(NOTE) and note.dtype.kind in "biuf":
                notes[name.removeprefix(NOTE)].append(float(note))
    return {
        name: {"mean": round(float(np.mean(values)), 6), "max": round(max(values), 6)}
        for name, values in sorted(notes.items())
        if np.isfinite(values).all()
    }


def _median_seconds(answered: Sequence[Mapping[Stage, Arrays]]) -> dict[str, NDArray[np.float64]]:
    """Return median seconds per shape by stage; see :func:`clock`."""
    seconds = defaultdict[str, list[NDArray[np.float64]]](list)
    for stages in answered:
        for stage, arrays in stages.items():
            for name, took in arrays.items():
                if name.startswith(SECONDS):
                    seconds[name.removeprefix(SECONDS)[1:] or STAGES[stage]].append(took)
    return {stage: np.median(values, axis=0) for stage, values in sorted(seconds.items())}

"""Rank a gallery: its distances from the cached signatures, and the content of its record."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor
from benchmark.api.scoring import Scorer
from benchmark.pipeline.cache import Arrays, Cache, Keys
from benchmark.pipeline.measures import score
from benchmark.pipeline.stages import FIRST, NOTE, REFUSED, SECONDS
from benchmark.registry.outputs import compare_signatures, compute_distances


class Ranked(NamedTuple):
    """Shapes that are ranked against each other: names, classes, keys of their files; those lost in this run."""

    shapes: Sequence[str]
    labels: Sequence[str]
    keys: Sequence[Keys]
    lost: Mapping[str, str]


def rank(
    gallery: Ranked, cache: Cache, compute: Callable[[int], object], comparing: Descriptor | Scorer
) -> tuple[dict[str, Any], Arrays]:
    """Rank a gallery whose shapes have all been processed.

    Parameters
    ----------
    gallery
        The shapes.
    cache
        The cached files.
    compute
        Computes the files of the shape with an index again; called if they are missing or damaged.
    comparing
        The scorer, or the descriptor that compares its own vectors.

    Returns
    -------
    dict
        The content of the record.
    dict
        ``distances`` of the answered shapes, shape (n, n), means over the draws; empty if all shapes are refused.
    """
    stages: dict[int, dict[str, Arrays]] = {}
    refused: dict[int, str] = {}
    unprepared: list[str] = []
    for index, (name, keys) in enumerate(zip(gallery.shapes, gallery.keys, strict=True)):
        if name in gallery.lost and not cache.has("forms", keys.form):
            refused[index] = gallery.lost[name]
            unprepared.append(name)
            continue
        of_shape: dict[str, Arrays] = {}
        for kind, key in keys.files():
            of_shape[kind] = arrays = _stored(cache, kind, key, lambda index=index: compute(index))  # type: ignore[misc]
            if REFUSED in arrays:
                refused[index] = "; ".join(filter(None, arrays[REFUSED].tolist()))
                unprepared += [name] if kind == "prepared" else []
                break
        else:
            stages[index] = of_shape
    unsupported = [(gallery.shapes[index], reason) for index, reason in sorted(refused.items())]
    if not stages:
        return {"unsupported": unsupported}, {}
    matrices = _distances(list(stages.values()), comparing)
    total, draws = np.zeros((len(stages), len(stages))), 0

    def summed() -> Iterator[NDArray[np.float64]]:
        nonlocal draws
        for matrix in matrices:
            np.add(total, matrix, out=total)
            draws += 1
            yield matrix

    content = {
        **score(summed(), gallery.labels, list(stages) if refused else None),
        "unsupported": unsupported,
        "unprepared": unprepared,
        "notes": _summary([_notes(of_shape) for of_shape in stages.values()]),
        "seconds": _seconds(list(stages.values())),
    }
    return content, {"distances": total / draws}


def _stored(cache: Cache, kind: Any, key: str, compute: Callable[[], object]) -> Arrays:
    """Return the arrays of a shape that ranking needs: not its surfaces."""
    surfaces = () if kind == "signatures" else ("vertices", "faces", "depth")
    arrays = cache.read(kind, key, surfaces)
    if arrays is None:
        compute()
        arrays = cache.read(kind, key, surfaces)
    if arrays is None:
        raise OSError(f"{kind}/{key}.npz cannot be read again")
    return arrays


def _distances(stages: Sequence[dict[str, Arrays]], comparing: Descriptor | Scorer) -> Iterator[NDArray[np.float64]]:
    """Yield the distances of the answered shapes for each draw; of a descriptor, its own."""
    if len(stages) == 1:
        yield np.zeros((1, 1))
    elif isinstance(comparing, Descriptor):
        yield compute_distances(comparing, [of_shape["forms"]["descriptor"] for of_shape in stages])
    else:
        signatures = [untimed(of_shape["signatures"]) for of_shape in stages]
        yield from (compare_signatures(comparing, signatures, draw) for draw in range(comparing.info.draws))


def untimed(signature: Arrays) -> Arrays:
    """Return the arrays of a signature that its scorer made."""
    return {name: array for name, array in signature.items() if name != SECONDS}


def _notes(of_shape: Mapping[str, Arrays]) -> dict[str, float]:
    """Return the numbers that preparation and method reported, by name."""
    named = [item for kind in ("prepared", "forms") for item in of_shape[kind].items() if item[0].startswith(NOTE)]
    return {name.removeprefix(NOTE): float(note) for name, note in named if note.dtype.kind in "biuf"}


def _seconds(stages: Sequence[dict[str, Arrays]]) -> dict[str, float]:
    """Return median seconds a shape by stage, without the first shape of each process unless there is no other."""
    settled = [of_shape for of_shape in stages if FIRST not in of_shape["forms"]] or stages
    names = {"prepared": "prepare", "forms": "canonicalise", "signatures": "signature"}
    phases: dict[str, list[float]] = {}
    for of_shape in settled:
        for kind, arrays in of_shape.items():
            for name in (name for name in arrays if name.partition(":")[0] == SECONDS):
                phases.setdefault(name.partition(":")[2] or names[kind], []).append(float(arrays[name]))
    return {phase: round(statistics.median(values), 4) for phase, values in sorted(phases.items())}


def _summary(all_notes: Sequence[Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the mean and the maximum of each note."""
    summary = {}
    for name in sorted({name for notes in all_notes for name in notes}):
        values = np.array([notes[name] for notes in all_notes if name in notes])
        if np.isfinite(values).all():
            summary[name] = {"mean": round(float(values.mean()), 6), "max": round(float(values.max()), 6)}
    return summary

"""Rank a gallery: its distances from the cached signatures, and the content of its record."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor
from benchmark.api.scoring import Scorer
from benchmark.pipeline.cache import Arrays, Cache
from benchmark.pipeline.forms import FIRST
from benchmark.pipeline.keys import Keys
from benchmark.pipeline.measures import score
from benchmark.pipeline.shapes import REFUSED, SECONDS, notes_of
from benchmark.registry.outputs import compare_signatures, compute_distances

_LARGE = ("vertices", "faces", "depth")


@dataclass(eq=False)
class Ranking:
    """A gallery whose shapes have all been processed.

    Parameters
    ----------
    cache
        The cached files.
    shapes, labels, keys
        Names and classes of the shapes, and the keys of their files.
    compute
        Computes the files of the shape with an index again; called if they are missing or damaged.
    lost
        Shapes that are refused in this run, with the reason.
    """

    cache: Cache
    shapes: Sequence[str]
    labels: Sequence[str]
    keys: Sequence[Keys]
    compute: Callable[[int], object]
    lost: Mapping[str, str]
    refused: dict[int, str] = field(default_factory=dict)
    unprepared: list[str] = field(default_factory=list)
    _small: dict[int, tuple[Arrays, Arrays, Arrays]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for index, (name, keys) in enumerate(zip(self.shapes, self.keys, strict=True)):
            if name in self.lost and not self.cache.has("forms", keys.form):
                self.refused[index] = self.lost[name]
                self.unprepared.append(name)
            elif reason := self._read_small(index, keys):
                self.refused[index] = reason

    def _read_small(self, index: int, keys: Keys) -> str:
        """Read times and notes of a shape; return the reason if it was refused, else ""."""
        prepared = self._stored("prepared", keys.prepared, index, _LARGE)
        if REFUSED in prepared:
            self.unprepared.append(self.shapes[index])
            return _reason(prepared)
        form = self._stored("forms", keys.form, index, _LARGE)
        if REFUSED in form:
            return _reason(form)
        signature: Arrays = {}
        if keys.signature:
            whole = self._stored("signatures", keys.signature, index)
            if REFUSED in whole:
                return _reason(whole)
            signature = {SECONDS: whole[SECONDS]}
        self._small[index] = prepared, form, signature
        return ""

    def _stored(self, kind: Any, key: str, index: int, without: Sequence[str] = ()) -> Arrays:
        arrays = self.cache.read(kind, key, without)
        if arrays is None:
            self.compute(index)
            arrays = self.cache.read(kind, key, without)
        if arrays is None:
            raise OSError(f"{kind}/{key}.npz cannot be read again")
        return arrays

    @property
    def answered(self) -> list[int]:
        """Indices of the shapes with a result."""
        return list(self._small)

    def distances(self, method: Descriptor | None, scorer: Scorer | None) -> Iterator[NDArray[np.float64]]:
        """Yield the distances of the answered shapes for each draw; of a descriptor, those of the method."""
        if len(self.answered) == 1:
            yield np.zeros((1, 1))
        elif method is not None:
            yield compute_distances(method, [self._small[index][1]["descriptor"] for index in self.answered])
        elif scorer is not None:
            signatures = _Signatures([lambda index=index: self._signature(index) for index in self.answered])  # type: ignore[misc]
            yield from (compare_signatures(scorer, signatures, draw) for draw in range(scorer.info.draws))

    def _signature(self, index: int) -> Arrays:
        stored = self._stored("signatures", self.keys[index].signature, index)
        return {name: array for name, array in stored.items() if name != SECONDS}

    def content(self, method: Descriptor | None, scorer: Scorer | None) -> tuple[dict[str, Any], Arrays]:
        """Return the content of the record, and the mean distances of the answered shapes, shape (n, n)."""
        total = np.zeros((len(self.answered),) * 2)
        draws = 0

        def summed() -> Iterator[NDArray[np.float64]]:
            nonlocal draws
            for matrix in self.distances(method, scorer):
                np.add(total, matrix, out=total)
                draws += 1
                yield matrix

        scored = score(summed(), self.labels, self.answered if self.refused else None)
        unsupported = [(self.shapes[index], reason) for index, reason in sorted(self.refused.items())]
        content = {
            **scored,
            "unsupported": unsupported,
            "unprepared": self.unprepared,
            "notes": _summary([notes_of(prepared, form) for prepared, form, _ in self._small.values()]),
            "seconds": _seconds(list(self._small.values())),
        }
        return content, {"distances": total / draws}


class _Signatures(Sequence[Arrays]):
    """Signatures that are read when they are taken, so that a large gallery need not be in memory."""

    def __init__(self, readers: Sequence[Callable[[], Arrays]]) -> None:
        self._readers = readers

    def __len__(self) -> int:
        return len(self._readers)

    @overload
    def __getitem__(self, index: int) -> Arrays: ...
    @overload
    def __getitem__(self, index: slice) -> _Signatures: ...
    def __getitem__(self, index: int | slice) -> Arrays | _Signatures:
        return _Signatures(self._readers[index]) if isinstance(index, slice) else self._readers[index]()


def _reason(arrays: Arrays) -> str:
    problem, hint = arrays[REFUSED].tolist()
    return f"{problem}; {hint}" if hint else str(problem)


def _seconds(stages: Sequence[tuple[Arrays, Arrays, Arrays]]) -> dict[str, float]:
    """Return median seconds a shape by stage, without the first shape of each process unless there is no other."""
    settled = [stage for stage in stages if FIRST not in stage[1]] or stages
    phases: dict[str, list[float]] = {}
    for prepared, form, signature in settled:
        times = {
            "prepare": prepared.get(SECONDS),
            "canonicalise": form.get(SECONDS),
            "signature": signature.get(SECONDS),
        }
        times |= {name.partition(":")[2]: array for name, array in form.items() if name.startswith(f"{SECONDS}:")}
        for phase, array in times.items():
            if array is not None:
                phases.setdefault(phase, []).append(float(array))
    return {phase: round(statistics.median(values), 4) for phase, values in sorted(phases.items())}


def _summary(all_notes: Sequence[Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return the mean and the maximum of each note."""
    summary = {}
    for name in sorted({name for notes in all_notes for name in notes}):
        values = np.array([notes[name] for notes in all_notes if name in notes])
        if np.isfinite(values).all():
            summary[name] = {"mean": round(float(values.mean()), 6), "max": round(float(values.max()), 6)}
    return summary

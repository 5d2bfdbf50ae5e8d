"""Rank a gallery: compute its distances block by block, and the content of its record."""

from __future__ import annotations

import hashlib
import json
import secrets
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Method
from benchmark.api.datasets import Entry
from benchmark.arrays import ABOUT, Arrays
from benchmark.errors import ShapeError
from benchmark.execution.processes.opened_files import with_files
from benchmark.pipeline.method_run import MethodRun, ShapeResult, files_of, in_random_order
from benchmark.pipeline.recipes import Recipe, distances_recipe, draws_of
from benchmark.pipeline.stages import measures
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.costs import Cost
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.records import Record, answered_shapes
from benchmark.pipeline.storage.store import Artefact, Store
from benchmark.plugins.output_checks import REFUSED, distances_of, form_distances
from benchmark.plugins.remote import Foreign

T = TypeVar("T")
Matrix = NDArray[np.float64]

#: Rows and columns of a block; a larger gallery is compared block by block.
BLOCK = 1024

#: Name of the array that describes the signatures of distances, so that ranking again needs no signatures.
_SIGNATURES = f"{ABOUT}signatures"

#: Name of the array stored with a block of distances: key of the recipe of the whole matrix, first row, first column.
_PLACE = f"{ABOUT}place"


class GalleryRanking:
    """The shapes of a gallery that can be ranked, and their distances.

    If all distances are stored from an earlier ranking, no signature is computed or read.

    Parameters
    ----------
    run
        Run of the method that computes the forms.
    gallery
        All shapes of the gallery.
    """

    #: Progress callback: gets the part of the distances that is being computed.
    tell: Callable[[str], object] = bool

    def __init__(self, run: MethodRun, gallery: Sequence[Entry]) -> None:
        self.run, self.gallery = run, gallery
        self.scorer = None if run.describes else run.scorer
        self.entries = list(gallery)
        self.results: dict[str, ShapeResult] = {}
        self.refused: list[tuple[str, str]] = []
        self.unprepared: list[str] = []
        self._seconds_before: dict[str, float] = {}
        self._files: dict[str, str] = {}
        self._read(signed=False)
        if not (run.describes or all(map(run.store.digest_under, self.keys))):
            self._read(signed=True)
        order = {entry.identifier: number for number, entry in enumerate(gallery)}
        self.refused.sort(key=lambda refusal: order[refusal[0]])
        self.unprepared.sort(key=order.__getitem__)

    def _read(self, *, signed: bool) -> None:
        """Read the result of each shape, and drop shapes without one."""

        def result(entry: Entry) -> ShapeResult | None:
            try:
                return self.run.result(entry, signed=signed)
            except ShapeError as error:
                self.refused.append((entry.identifier, str(error)))
                if REFUSED in self.run.preparation.artefact(entry).arrays:
                    self.unprepared.append(entry.identifier)
            return None

        results = zip(self.entries, in_random_order(result, self.entries), strict=True)
        self.results = {entry.identifier: of_shape for entry, of_shape in results if of_shape}
        self.entries = [entry for entry in self.entries if entry.identifier in self.results]
        spec, scorer = self.run.spec, self.run.scorer_spec
        forms = [self.run.recipe(entry) for entry in self.entries]
        self.recipes = {draw: distances_recipe(forms, spec, scorer, draw) for draw in draws_of(spec, scorer)}
        self._galleries = {draw: key_of(recipe) for draw, recipe in self.recipes.items()}

    # Distances -------------------------------------------------------------------------------------------------------

    def distances(self, draw: int | None) -> Iterable[Matrix]:
        """Return the rows of the distances for a draw: a matrix or, for a large gallery, row by row."""
        starts = self._starts(draw)
        return self._rows(draw, starts) if len(starts) > 1 else self._block(draw, 0, 0).arrays["distances"]

    def compare(self, draw: int | None, start: int) -> None:
        """Compute the block of rows that starts at row ``start``, up to and including the diagonal."""
        for row, column in self._blocks(draw) if self.results else ():
            if row == start:
                self._block(draw, row, column)

    @property
    def keys(self) -> list[str]:
        """Keys of all blocks of distances."""
        return [key_of(self._recipe(draw, *block)) for draw in self.recipes for block in self._blocks(draw)]

    def _blocks(self, draw: int | None) -> Iterator[tuple[int, int]]:
        """Return the first row and column of each block on or below the diagonal."""
        starts = self._starts(draw)
        return ((row, column) for row in starts for column in starts if column <= row)

    def _starts(self, draw: int | None) -> range:
        """Return the first row of each block; one block if a plugin compares or the matrix is stored whole."""
        count = len(self.entries)
        is_whole = self.scorer is None or isinstance(self.scorer, Foreign) or count <= BLOCK
        return range(0, max(count, 1), count or 1 if is_whole or self.run.store.has(self._galleries[draw]) else BLOCK)

    def _rows(self, draw: int | None, starts: range) -> Iterator[Matrix]:
        for row in starts:
            block = np.empty((min(BLOCK, starts.stop - row), starts.stop))
            for column in starts:
                part = self._block(draw, max(row, column), min(row, column)).arrays["distances"]
                block[:, column : column + BLOCK] = part if column <= row else part.T
            yield from block

    def _recipe(self, draw: int | None, row: int, column: int) -> Recipe:
        if len(self._starts(draw)) == 1:
            return self.recipes[draw]
        return self._recipe_of_part("distances", draw, rows=row, columns=column)

    def _recipe_of_part(self, stage: str, draw: int | None, **place: int) -> Recipe:
        gallery = keys.bare_key(self._galleries[draw])
        return {"stage": stage, "gallery": gallery, **place, "versions": self.recipes[draw]["versions"]}

    def _block(self, draw: int | None, row: int, column: int) -> Artefact:
        """Compute or read a block of distances."""
        block = self.run.store.get_or_compute(
            self._recipe(draw, row, column),
            lambda: with_files(self._compared(draw, row, column), files_of(self.scorer or self.run.method)),
            work="rank",
        )
        self._files |= block.files
        self._seconds_before.setdefault(block.key, block.cost.seconds if block.was_cached else 0.0)
        return block

    def _compared(self, draw: int | None, row: int, column: int) -> Arrays:
        scorer, method = self.scorer, self.run.method
        if len(self.entries) == 1:
            return {"distances": np.zeros((1, 1))}
        if draw is None or scorer is None:
            assert not isinstance(method, Method)  # noqa: S101
            descriptors = [result.answer.arrays["descriptor"] for result in self.results.values()]
            return {"distances": _in_order(descriptors, partial(distances_of, method), method)}
        if any(result.signature is None for result in self.results.values()):  # the file of the distances is damaged
            results = in_random_order(partial(self.run.result, signed=True), self.entries)
            self.results = dict(zip(self.results, results, strict=True))
        self.tell(f"comparing {len(self.entries)} forms, {draw + 1} of {len(self.recipes)}")
        about = {_SIGNATURES: np.array(json.dumps(self.signatures, sort_keys=True))}
        if len(self._starts(draw)) == 1:
            signatures = in_random_order(self.run.signature_arrays, self.entries)
            compare = lambda items: form_distances(scorer, items, draw)  # noqa: E731
            return {"distances": _in_order(signatures, compare, scorer), **about}
        of_suite: Any = scorer  # which can compare block by block
        return {
            "distances": of_suite.match(self._encoded(draw, row), self._encoded(draw, column)),
            **about,
            _PLACE: np.array(json.dumps([keys.bare_key(self._galleries[draw]), row, column])),
        }

    def _encoded(self, draw: int, start: int) -> list[Arrays]:
        """Return the encodings of a block of forms."""
        scorer: Any = self.scorer
        signature_arrays, store = partial(self.run.signature_arrays, in_gallery_order=True), self.run.store

        def encode() -> Arrays:
            codebook = store.get_or_compute(
                self._recipe_of_part("codebook", draw),
                lambda: scorer.codebook(map(signature_arrays, self.entries), draw),
                work="codebook",
                scratch=True,
            ).arrays
            entries = self.entries[start : start + BLOCK]
            return _joined([scorer.encode(signature_arrays(entry), codebook) for entry in entries])

        recipe = self._recipe_of_part("encoded", draw, rows=start, count=BLOCK)
        return _parted(store.get_or_compute(recipe, encode, work="encode", scratch=True).arrays)

    # Record ----------------------------------------------------------------------------------------------------------

    def content(self, begun: float) -> dict[str, Any]:
        """Return the content of the record of a ranking that began at a given time."""
        results, signatures, preparation = self.results.values(), self.signatures, self.run.preparation
        names, labels = ([getattr(entry, part) for entry in self.gallery] for part in ("identifier", "subject"))
        answered = [place for place, name in enumerate(names) if name in self.results] if self.refused else None
        scored = measures.scores(map(self.distances, self.recipes), labels, answered)
        stored = [artefact for result in results for artefact in (result.prepared, result.answer)]
        environments = Counter(artefact.environment for artefact in stored) + Counter(signatures["environments"])
        digests = {
            "shapes": _digest(result.prepared.digest for result in results),
            "forms": _digest(result.answer.digest for result in results),
            "signatures": signatures["digest"],
            "distances": _digest(map(self.run.store.digest_under, self.keys)),
        }
        read = [artefact.files for result in results for artefact in result.artefacts] + [self._files]
        files = {path: digest for part in read for path, digest in part.items()}
        models = {model.training: model.summary() for model in self.run.models.values()}
        return {
            "status": "ok",
            **scored,
            "shapes": names,
            "labels": labels,
            "n_shapes": len(names),
            "n_classes": len(set(labels)),
            "unsupported": self.refused,
            "unprepared": self.unprepared,
            "coverage": len(results) / max(len(names) - len(self.unprepared), 1),
            "digests": {stage: digest for stage, digest in digests.items() if digest},
            "notes": _summary([result.notes for result in results]),
            **_costs(results, signatures),
            "wall_seconds": round(time.perf_counter() - begun + sum(self._seconds_before.values()), 3),
            "environments": [{"environment": text, "artefacts": n} for text, n in sorted(environments.items())],
            "artefacts": sorted({artefact.key for artefact in stored} | {*self.keys, preparation.frame_key} - {""}),
            **({"files": files} if files else {}),
            **({"models": [*models.values()], "seen": self.run.seen(self.gallery)} if models else {}),
        }

    @cached_property
    def signatures(self) -> dict[str, Any]:
        """Digest of all signatures, median seconds per signature, and number of signatures by environment.

        These values are stored with the distances.
        """
        signatures = [result.signature for result in self.results.values() if result.signature]
        if signatures:
            return {
                "digest": _digest(signature.digest for signature in signatures),
                "seconds": _seconds([signature.cost for signature in signatures]),
                "environments": dict(Counter(signature.environment for signature in signatures)),
            }
        recipe = self._recipe(next(iter(self.recipes)), 0, 0)
        block = None if self.run.describes else self.run.store.find(recipe, wanted=_SIGNATURES.__eq__)
        about = block.arrays.get(_SIGNATURES) if block else None
        return {"digest": "", "seconds": 0.0, "environments": {}} if about is None else dict(json.loads(str(about)))


def matrices_of(record: Record, store: Store) -> Iterator[tuple[str, Matrix]]:
    """Yield the distance matrices of a record, shape (N, N) each, with the key of their recipe; none if freed."""
    count = len(answered_shapes(record))
    in_blocks: dict[str, Matrix] = defaultdict(lambda: np.full((count, count), np.nan))
    for key in record.get("artefacts", ()):
        artefact = store.under(key, {"distances", _PLACE}.__contains__)
        if artefact is None or "distances" not in artefact.arrays:
            continue
        block = artefact.arrays["distances"]
        if _PLACE in artefact.arrays:
            gallery, row, column = json.loads(str(artefact.arrays[_PLACE]))
            rows, columns = slice(row, row + block.shape[0]), slice(column, column + block.shape[1])
            in_blocks[gallery][rows, columns], in_blocks[gallery][columns, rows] = block, block.T
        elif block.shape == (count, count):
            yield keys.bare_key(key), block
    yield from ((gallery, matrix) for gallery, matrix in in_blocks.items() if not np.isnan(matrix).any())


def _joined(signatures: Sequence[Arrays]) -> Arrays:
    """Concatenate the arrays of several forms by name, and add their lengths."""
    joined: dict[str, Any] = {}
    for name in signatures[0]:
        arrays = [signature[name] for signature in signatures]
        joined |= {name: np.concatenate(arrays), f"lengths:{name}": np.array([len(array) for array in arrays])}
    return joined


def _parted(joined: Arrays) -> list[Arrays]:
    """Return the arrays of each form from the result of :func:`_joined`."""
    parts = {
        name: np.split(array, np.cumsum(joined[f"lengths:{name}"])[:-1])
        for name, array in joined.items()
        if not name.startswith("lengths:")
    }
    return [dict(zip(parts, arrays, strict=True)) for arrays in zip(*parts.values(), strict=True)]


def _in_order(items: Sequence[T], compare: Callable[[Sequence[T]], Matrix], by: object) -> Matrix:
    """Return the distances of all pairs; foreign code gets the gallery in an order that reveals nothing."""
    return in_shuffled_order(items, compare) if isinstance(by, Foreign) else compare(items)


def in_shuffled_order(items: Sequence[T], compare: Callable[[Sequence[T]], Matrix]) -> Matrix:
    """Compare all pairs of items in another order, and return the matrix in the original order.

    Parameters
    ----------
    items
        Descriptors or signatures of N shapes; a few of their statistics, never names, determine the order.
    compare
        Returns the dissimilarities of all pairs, shape (N, N).
    """
    places = [_place(item if isinstance(item, Mapping) else {"": np.asarray(item)}) for item in items]
    order = sorted(range(len(items)), key=places.__getitem__)
    back = np.argsort(order)
    return compare([items[number] for number in order])[np.ix_(back, back)]


def _place(arrays: Arrays) -> tuple[Any, ...]:
    """Return a sort key: statistics to six digits, then every bit; the order of copies is random."""
    measurements = []
    for name in sorted(arrays):
        sizes = np.abs(np.asarray(arrays[name], dtype=np.float64)).ravel()
        ramp = np.linspace(1, 2, sizes.size)
        moments = [f"{value:.6g}" for value in (sizes.mean(), (sizes * ramp).mean())] if sizes.size else []
        measurements += [name, str(np.shape(arrays[name])), *moments]
    digest = hashlib.sha256(" ".join(measurements).encode()).hexdigest()
    return digest, [arrays[name].tobytes() for name in sorted(arrays)], secrets.randbits(64)


def _digest(digests: Iterable[str]) -> str:
    """Return one digest of several, 16 hexadecimal digits; "" if one of them is unknown."""
    known = list(digests)
    return keys.digest(known)[:16] if all(known) else ""


def _settled(costs: Sequence[Cost]) -> Sequence[Cost]:
    """Return the costs without first uses, which include compiling and loading, unless there are no others."""
    return [cost for cost in costs if not cost.first_use] or costs


def _seconds(costs: Sequence[Cost]) -> float:
    return round(statistics.median(cost.seconds for cost in _settled(costs)), 4)


def _costs(results: Iterable[ShapeResult], signatures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the seconds per shape by phase and the memory of a form, without first shapes of processes if possible."""
    phases: dict[str, list[Cost]] = {}
    for result in results:
        phases.setdefault("prepare", []).append(result.prepared.cost)
        for stage, cost in result.answer.cost.shared.items():
            phases.setdefault(stage, []).append(cost)
        phases.setdefault("canonicalise", []).append(result.answer.cost)
    of_signatures = {"features": signatures["seconds"]} if signatures["environments"] else {}
    forms = _settled(phases["canonicalise"])
    peaks = [cost.peak_mib for cost in forms if cost.peak_mib is not None]
    return {
        "cost": {
            "seconds_per_shape": {phase: _seconds(costs) for phase, costs in phases.items()} | of_signatures,
            "shapes_timed": len(forms),
        },
        "peak_mib": round(max(peaks), 1) if peaks else None,
    }


def _summary(all_notes: Sequence[Mapping[str, float | str]]) -> dict[str, Any]:
    """Return the mean and maximum of each numeric note, and the count of each text."""
    summary: dict[str, Any] = {}
    for name in sorted({name for notes in all_notes for name in notes}):
        values = [notes[name] for notes in all_notes if name in notes]
        if all(isinstance(value, (int, float)) for value in values):
            numbers = np.asarray(values, dtype=np.float64)
            is_finite = np.isfinite(numbers).all()
            summary[name] = {"mean": float(numbers.mean()), "max": float(numbers.max())} if is_finite else None
        else:
            summary[name] = {str(value): values.count(value) for value in values}
    return summary

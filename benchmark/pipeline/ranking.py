"""Rank a gallery: its distances from the cached signatures, and the content of its record."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
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

#: Returns what a scorer or descriptor returned as a matrix of a shape, or raises an error that
#: names it; see :func:`benchmark.pipeline.outputs.make_distance_check`.
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


#: Decimals of seconds, and of notes, in a record.
_DECIMALS_OF_SECONDS = 4
_DECIMALS_OF_NOTES = 6

#: Kinds of numpy's types that are numbers.
_NUMBERS = "biuf"


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
    """Rank the shapes of a gallery by their distances from each query, and score the rankings.

    A shape that was refused has no distances, and scores 0 as a query.

    Parameters
    ----------
    record
        The record of the job without its outcome: shapes, classes and keys of their files.
    cache
        The cached files, with the signature or descriptor of each shape.
    comparing
        The scorer, which compares signatures; or the method that compares its own descriptors.
    check
        Checks each matrix that it computes.

    Returns
    -------
    content : dict
        What the record says of the outcome: scores, refused shapes, notes and seconds.
    arrays : dict
        ``distances``, shape (queries, gallery): the mean over the draws of the scorer, of the
        shapes that were not refused. Empty if all were.

    Raises
    ------
    DamagedFiles
        If files of a shape are missing or damaged.
    """
    start = clock()
    queries = _read(record, cache)
    gallery = queries
    if record.gallery_of_queries:
        gallery = _read(record.gallery_of_queries, cache)
    for side in (queries, gallery):
        if not side.stages:
            return side.refusals, {}

    # Compare the queries with the gallery; without other queries, the gallery with itself.
    outputs = queries.last_arrays if record.gallery_of_queries else None
    matrices = distances(comparing, check, gallery.last_arrays, outputs)

    # The distance of a shape that is seen in several views is the least of theirs.
    shapes, first_views = np.unique(gallery.shape_indices, return_index=True)
    if len(shapes) < len(gallery.stages):
        matrices = _nearest_views(matrices, first_views)

    # Measures are taken of each draw of the scorer, and the mean of the distances is kept.
    mean = _MeanOfMatrices()
    targets = record.targets
    if targets:
        targets = replace(targets, answered=shapes.tolist())
    scores = score_draws(mean.watch(matrices), record.labels, [*queries.stages], targets)

    content = {**scores, **queries.refusals}
    if record.gallery_of_queries:
        content["against"] = msgspec.to_builtins(record.gallery_of_queries) | gallery.refusals

    stages = [*queries.stages.values()]
    content["notes"] = _summarise_notes(stages)
    content["machines"] = _machines(stages)
    seconds = _median_seconds(stages)
    seconds[STAGES["records"]] = (clock() - start) / len(record.shapes)
    content["seconds"] = _rounded(seconds, 0)
    content["processor_seconds"] = _rounded(seconds, 1)
    return content, {"distances": mean.value}


@dataclass
class _SideArrays:
    """The cached arrays of queries, or of their gallery.

    Parameters
    ----------
    n_views
        Number of views of each shape.
    stages
        Arrays of each view with a result, by the index of the view and by stage.
    refusals
        What a record says of shapes without a result.
    """

    n_views: int
    stages: dict[int, dict[Stage, Arrays]] = field(default_factory=dict)
    refusals: dict[str, Any] = field(default_factory=dict)

    @property
    def last_arrays(self) -> list[Arrays]:
        """The descriptor or signature of each view with a result."""
        return [[*stages.values()][-1] for stages in self.stages.values()]

    @property
    def shape_indices(self) -> NDArray[np.int64]:
        """Index of the shape of each view with a result."""
        return np.array([*self.stages]) // self.n_views


def _read(side: RankedShapes, cache: Cache) -> _SideArrays:
    """Read the cached files of the queries, or of the gallery.

    Parameters
    ----------
    side
        Queries or gallery: names of shapes, and keys of the files of each of their views.
    cache
        The cached files.

    Returns
    -------
    _SideArrays
        Arrays of each view by stage, and the shapes of which all views were refused, with reasons.

    Raises
    ------
    DamagedFiles
        If a file is missing or damaged; all of them are named.
    """
    arrays_of_side = _SideArrays(side.views)
    reasons: dict[int, tuple[Stage, str]] = {}
    damaged: list[tuple[Stage, str]] = []
    # Each view has a file of each stage: prepared shape, form, signature. Of the first two, only
    # notes and seconds are needed, not the surfaces.
    for index, view in enumerate(side.views_of_shapes):
        stages: dict[Stage, Arrays] = {}
        for stage, key in view.keys.items():
            without = () if stage == "signatures" else _SURFACES
            arrays = cache.read(stage, key, without=without)
            if arrays is None:
                damaged.append((stage, key))
                continue
            if REFUSED in arrays:  # later stages have no file
                reasons[index] = stage, "; ".join(filter(None, arrays[REFUSED].tolist()))
                break
            stages[stage] = arrays
        if index not in reasons:
            arrays_of_side.stages[index] = stages
    if damaged:
        raise DamagedFiles(damaged)

    # A shape has a result if one of its views has; otherwise, its first view gives the reason.
    with_result = {index // side.views for index in arrays_of_side.stages}
    unsupported = []
    unprepared = []
    for number, shape in enumerate(side.shapes):
        if number not in with_result:
            stage, reason = reasons[number * side.views]
            unsupported.append((shape, reason))
            if stage == "prepared":
                unprepared.append(shape)
    arrays_of_side.refusals = {"unsupported": unsupported, "unprepared": unprepared}
    return arrays_of_side


def _nearest_views(
    matrices: Iterable[NDArray[np.float64]], first_views: NDArray[np.int64]
) -> Iterator[NDArray[np.float64]]:
    """Yield distances of shapes: each the least of its views, whose first columns are given."""
    for matrix in matrices:
        yield np.minimum.reduceat(matrix, first_views, axis=1)


class _MeanOfMatrices:
    """The mean of matrices that pass by."""

    def __init__(self) -> None:
        self._total: NDArray[np.float64] = np.zeros(())
        self._count = 0

    def watch(self, matrices: Iterable[NDArray[np.float64]]) -> Iterator[NDArray[np.float64]]:
        """Yield matrices as they are."""
        for matrix in matrices:
            self._total = self._total + matrix
            self._count += 1
            yield matrix

    @property
    def value(self) -> NDArray[np.float64]:
        """The mean of the matrices that have passed."""
        return self._total / self._count


def distances(
    comparing: Descriptor | Scorer,
    check: Check,
    outputs: Sequence[Arrays],
    queries: Sequence[Arrays] | None = None,
) -> Iterator[NDArray[np.float64]]:
    """Yield the matrix of distances of each draw of a scorer: queries (rows) to the gallery.

    A scorer may use random numbers, for example for a codebook, and is then drawn several times.

    Parameters
    ----------
    comparing
        The scorer, which compares signatures; or the method that compares its own descriptors,
        once.
    check
        Checks each matrix that it computes.
    outputs
        Cached signatures, or descriptors, of the gallery.
    queries
        Those of the queries; None compares the gallery with itself.
    """
    if queries is None and len(outputs) == 1:
        yield np.zeros((1, 1))
        return
    extract: Callable[[Arrays], Any] = _descriptor
    n_draws = 1
    if isinstance(comparing, Scorer):
        extract = _signature
        n_draws = comparing.info.draws
    of_gallery = [extract(arrays) for arrays in outputs]
    of_queries = None if queries is None else [extract(arrays) for arrays in queries]
    for draw in range(n_draws):
        yield distances_of_draw(comparing, check, of_gallery, draw, of_queries)


def _signature(arrays: Arrays) -> dict[str, NDArray[Any]]:
    """Return the signature in the arrays of a file: all but the seconds that it took."""
    return {name: array for name, array in arrays.items() if name != SECONDS}


def _descriptor(arrays: Arrays) -> NDArray[Any]:
    """Return the descriptor in the arrays of a file."""
    return arrays["descriptor"]


def distances_of_draw(
    comparing: Descriptor | Scorer,
    check: Check,
    outputs: Sequence[Any],
    draw: int = 0,
    queries: Sequence[Any] | None = None,
) -> NDArray[np.float64]:
    """Return the dissimilarities of queries to the shapes of a gallery, for one draw of a scorer.

    If the scorer has a method ``compare_to(queries, gallery, draw)``, that is called. Otherwise
    each query is compared as one more shape of the gallery, which costs (N + 1) x (N + 1)
    dissimilarities a query.

    Parameters
    ----------
    comparing
        The scorer, which compares signatures; or the method that compares its own descriptors.
    check
        Checks the matrix that it computes.
    outputs
        Signatures, or descriptors, of the N shapes of the gallery.
    draw
        Number of the draw; descriptors are compared without one.
    queries
        Those of M queries, at least one; None compares the gallery with itself.

    Returns
    -------
    numpy.ndarray
        Shape (M, N), or (N, N) without queries. Each row is that of its query alone.
    """
    of_gallery = _copies(outputs)
    shape = len(of_gallery), len(of_gallery)
    if queries is None:
        if isinstance(comparing, Scorer):
            return check(comparing.compare(of_gallery, draw), shape)
        return check(comparing.distances(of_gallery), shape)
    compare_to = getattr(comparing, "compare_to", None)
    if compare_to:
        matrix = compare_to(_copies(queries), of_gallery, draw)
        return check(matrix, (len(queries), len(of_gallery)))
    # The query is the last shape: the last row, without its last entry, holds its distances.
    rows = []
    for query in queries:
        matrix = distances_of_draw(comparing, check, [*outputs, query], draw)
        rows.append(matrix[-1, :-1].copy())  # a view would keep its matrix
    return np.stack(rows)


def _copies(outputs: Sequence[Any]) -> tuple[Any, ...]:
    """Return vectors or signatures for one call: what it changes in them reaches no other draw."""
    return tuple(map(_copy, outputs))


def _copy(output: Any) -> Any:
    """Return a signature with its own names, whose arrays are read-only; a vector as it is."""
    return dict(output) if isinstance(output, Mapping) else output


def _summarise_notes(answered: Iterable[Mapping[Stage, Arrays]]) -> dict[str, dict[str, float]]:
    """Return mean and maximum over all shapes of each number that was noted on them.

    Notes are stored as arrays of one number, such as ``note:iterations``. A note with an infinite
    or undefined value is left out.

    Parameters
    ----------
    answered
        For each shape with a result, its cached arrays by stage.
    """
    notes: defaultdict[str, list[float]] = defaultdict(list)
    for stages in answered:
        for name, note in {**stages["prepared"], **stages["forms"]}.items():
            if name.startswith(NOTE) and note.dtype.kind in _NUMBERS:
                notes[name.removeprefix(NOTE)].append(float(note))
    return {
        name: {
            "mean": round(float(np.mean(values)), _DECIMALS_OF_NOTES),
            "max": round(max(values), _DECIMALS_OF_NOTES),
        }
        for name, values in sorted(notes.items())
        if np.isfinite(values).all()
    }


def _machines(answered: Iterable[Mapping[Stage, Arrays]]) -> list[str]:
    """Return the machines that made the forms; none of forms that do not say so."""
    machines = set()
    for stages in answered:
        form = stages["forms"]
        if MACHINE in form:
            machines.add(str(form[MACHINE]))
    return sorted(machines)


def _median_seconds(answered: Iterable[Mapping[Stage, Arrays]]) -> dict[str, NDArray[np.float64]]:
    """Return median seconds per shape by stage, of the wall and of the processor."""
    seconds: defaultdict[str, list[NDArray[np.float64]]] = defaultdict(list)
    for stages in answered:
        for stage, arrays in stages.items():
            for name, spent in arrays.items():
                if name.startswith(SECONDS):  # ":seconds", or ":seconds:geodesics"
                    part = name.removeprefix(SECONDS).removeprefix(":")
                    seconds[part or STAGES[stage]].append(spent)
    return {stage: np.median(spent, axis=0) for stage, spent in sorted(seconds.items())}


def _rounded(seconds: Mapping[str, NDArray[np.float64]], place: int) -> dict[str, float]:
    """Return the seconds of one clock by stage; see :func:`benchmark.pipeline.stages.clock`."""
    return {
        stage: round(float(clocks[place]), _DECIMALS_OF_SECONDS)
        for stage, clocks in seconds.items()
    }

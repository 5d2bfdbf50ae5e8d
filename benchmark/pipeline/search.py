"""Retrieve the shapes of a finished gallery nearest to a new shape, from its cached forms."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Arrays, Cache
from benchmark.pipeline.ranking import untimed
from benchmark.pipeline.records import Record
from benchmark.pipeline.stages import SharedStages, compute_answer, mesh_of, require_result, sign
from benchmark.registry.outputs import compare_signatures, compute_distances


@dataclass(frozen=True)
class Hit:
    """A retrieved shape, its class, and its distance from the query: the mean over the draws of the scorer."""

    shape: str
    subject: str
    distance: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Result of a search.

    Parameters
    ----------
    hits
        All shapes of the gallery that have a form, nearest first.
    form
        Canonical form of the query; None for a descriptor.
    """

    hits: tuple[Hit, ...]
    form: Mesh | None

    @property
    def margin(self) -> float:
        """Margin between the nearest class and the second nearest, relative to the distance of the second."""
        first = self.hits[0]
        other = next((hit for hit in self.hits if hit.subject != first.subject), None)
        return 0.0 if other is None or not other.distance > 0 else 1 - first.distance / other.distance


def search(
    results: Path,
    record: Record,
    query: Shape,
    method: Method | Descriptor,
    scorer: Scorer,
    without: Collection[str] = (),
) -> SearchResult:
    """Rank the shapes of a finished gallery by their distance from a shape.

    Parameters
    ----------
    results, record
        The results folder, and the record of the gallery.
    query
        The query, prepared as the shapes of the gallery.
    method, scorer
        Method with its model, and scorer, of the record.
    without
        Shapes of the gallery to leave out, such as the query itself.

    Raises
    ------
    ConfigurationError
        If no form of the gallery is kept here.
    ShapeError
        If the query is refused.
    """
    answer = require_result(compute_answer(method, query, SharedStages(), first=False))
    describes = isinstance(method, Descriptor)
    known = _stored(results, record, without, describes=describes)
    if not known:
        raise ConfigurationError(f"no form of {record.row} is kept in {results}", "run it again here")
    form = None if describes else mesh_of(answer, {"faces": query.mesh.faces})
    if isinstance(method, Descriptor):
        vectors = [arrays["descriptor"] for arrays in (*known.values(), answer)]
        distances = compute_distances(method, vectors)[-1, :-1]
    else:
        assert form is not None  # noqa: S101
        signatures = [*map(untimed, known.values()), untimed(require_result(sign(scorer, form)))]
        draws = [compare_signatures(scorer, signatures, draw)[-1, :-1] for draw in range(scorer.info.draws)]
        distances = np.mean(draws, axis=0)
    pairs = sorted(zip(distances.tolist(), known, strict=True))
    return SearchResult(tuple(Hit(record.shapes[k], record.labels[k], distance) for distance, k in pairs), form)


def _stored(results: Path, record: Record, without: Collection[str], *, describes: bool) -> dict[int, Arrays]:
    """Return the descriptors or signatures of the shapes of a record, by index."""
    if record.files is None:
        return {}
    keys = record.files.forms if describes else record.files.signatures
    answered = [index for index in record.answered if record.shapes[index] not in without]
    stored = {index: Cache(results).read("forms" if describes else "signatures", keys[index]) for index in answered}
    return {index: arrays for index, arrays in stored.items() if arrays is not None}

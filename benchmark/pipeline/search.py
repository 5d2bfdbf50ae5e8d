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
from benchmark.pipeline.forms import SharedStages, compute_answer, mesh_of, sign
from benchmark.pipeline.records import Record
from benchmark.pipeline.shapes import REFUSED, SECONDS, require_result
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
    form = None if describes else mesh_of(answer, {"faces": query.mesh.faces})
    known = [(index, arrays) for index, arrays in _stored(results, record, scorer, without, describes=describes)]
    if not known:
        raise ConfigurationError(f"no form of {record.place} is kept in {results}", "run it again here")
    if isinstance(method, Descriptor):
        vectors = [arrays["descriptor"] for arrays in (*(arrays for _, arrays in known), answer)]
        distances = compute_distances(method, vectors)[-1, :-1]
    else:
        assert form is not None  # noqa: S101
        signatures = [*(arrays for _, arrays in known), _plain(require_result(sign(scorer, form)))]
        draws = [compare_signatures(scorer, signatures, draw)[-1, :-1] for draw in range(scorer.info.draws)]
        distances = np.mean(draws, axis=0)
    order = np.argsort(distances, kind="stable")
    hits = ((known[place][0], float(distances[place])) for place in order)
    return SearchResult(tuple(Hit(record.shapes[k], record.labels[k], distance) for k, distance in hits), form)


def _stored(
    results: Path, record: Record, scorer: Scorer, without: Collection[str], *, describes: bool
) -> list[tuple[int, Arrays]]:
    """Return the descriptors or signatures of the shapes of a record, with their indices."""
    cache, found = Cache(results), []
    for index in record.answered if record.files else ():
        assert record.files is not None  # noqa: S101
        if record.shapes[index] in without:
            continue
        key = record.files.forms[index] if describes else record.files.signatures[index]
        arrays: Arrays | None = cache.read("forms" if describes else "signatures", key)
        if arrays is None and not describes:
            form = cache.read("forms", record.files.forms[index])
            prepared = cache.read("prepared", record.files.prepared[index])
            arrays = None if form is None or prepared is None else sign(scorer, mesh_of(form, prepared))
        if arrays is not None and REFUSED not in arrays:
            found.append((index, arrays if describes else _plain(arrays)))
    return found


def _plain(signature: Arrays) -> Arrays:
    return {name: array for name, array in signature.items() if name != SECONDS}

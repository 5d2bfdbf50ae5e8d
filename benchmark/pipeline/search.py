"""Retrieve the shapes of a finished gallery nearest to a new shape, from its cached forms."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Arrays, Cache, Stage
from benchmark.pipeline.forms import SharedResults, mesh_of
from benchmark.pipeline.outputs import compute_output, make_distance_check, sign
from benchmark.pipeline.ranking import distances
from benchmark.pipeline.records import RankedShapes
from benchmark.pipeline.stages import NOTE, REFUSED, require_result


class Hit(NamedTuple):
    """A retrieved shape, its class, and its distance from the query: the mean over the draws of the scorer."""

    shape: str
    subject: str
    distance: float


class SearchResult(NamedTuple):
    """Shapes of the gallery that have a form, nearest first, and the form of the query; None for a descriptor.

    ``margins`` are those of the nearest class before the second, one for each draw of the scorer,
    relative to the mean distance of the second; empty without a second class, or if its distance is
    0. ``notes`` are those of the method on the form of the query.
    """

    hits: list[Hit]
    form: Mesh | None
    margins: NDArray[np.float64]
    notes: Mapping[str, float | str] = MappingProxyType({})

    @property
    def margin(self) -> float:
        """Margin between the nearest class and the second nearest, relative to the distance of the second."""
        return float(self.margins.mean()) if len(self.margins) else 0.0

    @property
    def is_decided(self) -> bool:
        """Whether the margin is larger than what the draws of the scorer differ by."""
        return len(self.margins) > 0 and self.margin > float(np.ptp(self.margins))


def search(
    results: Path,
    gallery: RankedShapes,
    query: Shape,
    method: Method | Descriptor,
    scorer: Scorer,
    without: Collection[str] = (),
) -> SearchResult:
    """Rank the shapes of a finished gallery by their distance from a shape.

    Parameters
    ----------
    results, gallery
        The results folder, and the gallery of a record.
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
    answer = require_result(compute_output(method, query, SharedResults()))
    notes = _notes_of(answer)
    stage: Stage = "forms"
    form = None
    if isinstance(method, Method):
        stage, form = "signatures", mesh_of(answer, {"faces": query.mesh.faces})
        answer = require_result(sign(scorer, form))
    keys, cache, views = gallery.keys, Cache(results), gallery.views
    wanted = [index for index in gallery.answered if keys and gallery.shapes[index] not in without]
    found = {
        (index, k): cache.read(stage, keys[index * views + k][stage])
        for index in wanted
        for k in range(views)
    }
    stored = {
        place: arrays
        for place, arrays in found.items()
        if arrays is not None and REFUSED not in arrays
    }
    if not stored:
        raise ConfigurationError(
            f"no form of {gallery.gallery} is kept in {results}", "run it again here"
        )
    comparing = scorer if isinstance(method, Method) else method
    numbers, first = np.unique([index for index, _ in stored], return_index=True)
    draws = np.concatenate(
        [*distances(comparing, make_distance_check(comparing), [*stored.values()], [answer])]
    )
    draws = np.minimum.reduceat(draws, first, axis=1)  # the least distance of the views of a shape
    nearness = draws.mean(axis=0)
    order = np.lexsort([numbers, nearness]).tolist()
    labels = [gallery.labels[index] for index in numbers]
    hits = [Hit(gallery.shapes[numbers[k]], labels[k], float(nearness[k])) for k in order]
    second = next((k for k in order if labels[k] != hits[0].subject and nearness[k] > 0), None)
    margins = [] if second is None else (draws[:, second] - draws[:, order[0]]) / nearness[second]
    return SearchResult(hits, form, np.array(margins), notes)


def _notes_of(output: Arrays) -> dict[str, float | str]:
    """Return the notes of a method on a form, from the arrays that are stored."""
    return {
        name.removeprefix(NOTE): note.item()
        for name, note in output.items()
        if name.startswith(NOTE)
    }

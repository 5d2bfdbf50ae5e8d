"""Retrieve the shapes of a finished gallery nearest to a new shape, from its cached forms."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Descriptor, Method, Shape
from benchmark.api.scoring import Scorer
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Cache, Stage
from benchmark.pipeline.forms import SharedResults, mesh_of
from benchmark.pipeline.outputs import compute_output, make_distance_check, sign
from benchmark.pipeline.ranking import distances
from benchmark.pipeline.records import RankedShapes, ShapeView
from benchmark.pipeline.stages import NOTE, REFUSED, Arrays, require_result
from benchmark.text import listed


class Hit(NamedTuple):
    """A retrieved shape.

    Parameters
    ----------
    shape, subject
        Its name and its class.
    distance
        Its distance from the query: the mean over the draws of the scorer.
    """

    shape: str
    subject: str
    distance: float


class SearchResult(NamedTuple):
    """Shapes of a gallery by their distance from a query.

    Parameters
    ----------
    hits
        The shapes that have a form, nearest first.
    form
        The form of the query; None for a descriptor.
    margins
        By how much the nearest class is before the second one, for each draw of the scorer,
        relative to the mean distance of the second; empty without a second class, or if its
        distance is 0.
    notes
        Notes of the method on the form of the query.
    """

    hits: list[Hit]
    form: Mesh | None
    margins: NDArray[np.float64]
    notes: Mapping[str, float | str] = MappingProxyType({})

    @property
    def margin(self) -> float:
        """Mean of the margins; 0 without any."""
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
    """Rank the shapes of a gallery by their distances from a new shape.

    Parameters
    ----------
    results
        The results folder with the forms of the gallery.
    gallery
        The shapes, with the keys of their files, as a record holds them.
    query
        The new shape, prepared as the shapes of the gallery.
    method, scorer
        The method, with its trained model, and the scorer that made these files.
    without
        Names of shapes of the gallery to leave out, such as the query itself.

    Raises
    ------
    ConfigurationError
        If a form of the gallery is not stored here, or its file is damaged; or it has none besides
        those to leave out.
    ShapeError
        If the query is refused.
    """
    output = require_result(compute_output(method, query, SharedResults()))
    form = None
    comparing: Descriptor | Scorer
    if isinstance(method, Method):
        form = mesh_of(output, {"faces": query.mesh.faces})
        of_query = require_result(sign(scorer, form))
        stage: Stage = "signatures"
        comparing = scorer
    else:  # it makes descriptors, which it compares itself
        of_query = output
        stage = "forms"
        comparing = method

    arrays_of_views, missing = _read_gallery(Cache(results), gallery, stage, without)
    if missing:
        n_forms = len(missing) + len(arrays_of_views)
        problem = (
            f"{len(missing)} of {n_forms} forms of {gallery.gallery} are not kept in {results}: "
            f"{listed(missing)}"
        )
        raise ConfigurationError(problem, "run its job again with --force")
    if not arrays_of_views:
        problem = f"{gallery.gallery} has no other shape with a form"
        raise ConfigurationError(problem, "choose another gallery")
    check = make_distance_check(comparing)
    matrices = distances(comparing, check, [*arrays_of_views.values()], [of_query])
    distances_of_views = np.concatenate([*matrices])  # (draws of the scorer, views)
    shapes, of_draws = _distances_of_shapes(distances_of_views, [*arrays_of_views], gallery.views)

    # Shapes at equal distances keep the order of the gallery.
    mean_distances = of_draws.mean(axis=0)
    order = np.lexsort([shapes, mean_distances])
    hits = [
        Hit(gallery.shapes[shapes[k]], gallery.labels[shapes[k]], float(mean_distances[k]))
        for k in order.tolist()
    ]
    margins = _margins(hits, of_draws[:, order])
    return SearchResult(hits, form, margins, _notes_of(output))


def _distances_of_shapes(
    distances_of_views: NDArray[np.float64], views: Sequence[int], n_views: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the distances of shapes: of each, the least distance of its views.

    Parameters
    ----------
    distances_of_views
        Shape (draws, v).
    views
        Index of each of the v views in the gallery, where the views of a shape follow each other.
    n_views
        Number of views of each shape in the gallery.

    Returns
    -------
    shapes : numpy.ndarray
        Indices of the s shapes with a view, ascending.
    distances : numpy.ndarray
        Shape (draws, s).
    """
    shape_of_view = [view // n_views for view in views]
    shapes, first_views = np.unique(shape_of_view, return_index=True)
    return shapes, np.minimum.reduceat(distances_of_views, first_views, axis=1)


def _margins(hits: Sequence[Hit], of_draws: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much the nearest class is before the second one, for each draw of the scorer.

    Parameters
    ----------
    hits
        The shapes, nearest first.
    of_draws
        Their distances, shape (draws, shapes).

    Returns
    -------
    numpy.ndarray
        Shape (draws,), relative to the mean distance of the second class; empty if there is none.
    """
    second = _first_of_second_class(hits)
    if second is None:
        return np.empty(0)
    return np.asarray((of_draws[:, second] - of_draws[:, 0]) / hits[second].distance)


def _read_gallery(
    cache: Cache, gallery: RankedShapes, stage: Stage, without: Collection[str]
) -> tuple[dict[int, Arrays], list[str]]:
    """Return the arrays of a stage for each view with a result.

    Returns
    -------
    arrays_of_views : dict
        Arrays by the index of the view.
    missing : list of str
        Names of the views whose file is not here, or is damaged.
    """
    left_out = {*without, *(name for name, _ in gallery.unsupported)}
    arrays_of_views: dict[int, Arrays] = {}
    missing: list[str] = []
    for index, view in enumerate(gallery.views_of_shapes):
        if view.shape in left_out:
            continue
        arrays = cache.read(stage, view.keys[stage]) if stage in view.keys else None
        if arrays is None:
            if not _is_refused_before(cache, view, stage):
                missing.append(view.name)
        elif REFUSED not in arrays:
            arrays_of_views[index] = arrays
    return arrays_of_views, missing


def _is_refused_before(cache: Cache, view: ShapeView, last: Stage) -> bool:
    """Return whether a view was refused in an earlier stage, so that it has no file of the last."""
    for stage, key in view.keys.items():
        if stage == last:
            return False
        arrays = cache.read(stage, key, only=[REFUSED])
        if arrays and REFUSED in arrays:
            return True
    return False


def _first_of_second_class(hits: Sequence[Hit]) -> int | None:
    """Return the place of the first hit of the second class with a distance above 0."""
    for place, hit in enumerate(hits):
        if hit.subject != hits[0].subject and hit.distance > 0:
            return place
    return None


def _notes_of(output: Arrays) -> dict[str, float | str]:
    """Return the notes of a method on a form, from the arrays that are stored."""
    return {
        name.removeprefix(NOTE): note.item()
        for name, note in output.items()
        if name.startswith(NOTE)
    }

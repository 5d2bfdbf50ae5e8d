"""Arrays that belong to a record: distances, prepared shapes and forms, as far as they are here."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.code_digest import digest_of_bytes
from benchmark.errors import InvalidMesh
from benchmark.files import read_file
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import RUNS, Cache, Stage, UnreadableFile
from benchmark.pipeline.record_files import _say_skipped, published_folder
from benchmark.pipeline.records import RankedShapes, Record

#: Kinds of types of NumPy that are real numbers.
_NUMBERS = "iuf"

#: Arrays of prepared shapes and forms that pages and figures read.
_READ = ("vertices", "faces", "vertex_map", "note:vertices_before")


def read_distances(results: Path, record: Record) -> NDArray[np.float64] | None:
    """Return the distances of queries to the shapes of the gallery, by which a record was scored.

    Parameters
    ----------
    results
        The results folder.
    record
        The record.

    Returns
    -------
    numpy.ndarray or None
        Shape (queries, shapes of the gallery), both without refused ones: means over the draws of
        the scorer. Published ones have single precision. None if they are not stored here, or their
        file is damaged, which is said on stderr.
    """
    # Distances of a job that ran here.
    shape = len(record.answered), len(record.sides[-1].answered)
    distances = _read_cached(results, "records", record.key, ["distances"]).get("distances")
    if distances is not None and distances.shape == shape:
        if distances.dtype.kind in _NUMBERS and np.isfinite(distances).all():
            return distances
        reason = "they are no finite numbers; run its job again with --force"
        _say_skipped(f"distances of {record.row}: {reason}")

    # Those that were published with the record.
    if not record.distances:
        return None
    path = published_distances(results, record.distances)
    try:
        distances = _read_published(path, record.distances)
    except (OSError, ValueError) as error:
        _say_skipped(f"{path}: {getattr(error, 'strerror', error)}")
        return None
    return distances if distances.shape == shape else None


def _read_published(path: Path, digest: str) -> NDArray[np.float64]:
    """Return the matrix of published distances; raise ``ValueError`` if they were changed."""
    from scipy.spatial.distance import squareform  # lazy: tables need no distances

    content = read_file(path)
    above_diagonal = np.frombuffer(content, "<f4")
    if digest_of_bytes(content) != digest or not np.isfinite(above_diagonal).all():
        raise ValueError("it was changed after it was published")
    return np.asarray(squareform(above_diagonal.astype(np.float64)))


def published_distances(results: Path, digest: str) -> Path:
    """Return the file of published distances.

    It holds those above the diagonal, by row, as numbers of four bytes.
    """
    return published_folder(results) / "records" / "distances" / f"{digest}.f4"


def read_prepared(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the prepared surface of a shape of a record.

    None means that it is not kept here, is damaged, or could not be prepared.
    """
    arrays = _read_arrays(results, record, "prepared", shape)
    return _mesh_of(f"surface of '{shape}'", arrays.get("vertices"), arrays.get("faces"))


def read_form(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the canonical form of a shape of a record.

    None means that it is not kept here, is damaged, or that there is none.
    """
    form = _read_arrays(results, record, "forms", shape)
    # A form that keeps the faces of its shape is stored without them.
    faces = form.get("faces")
    if faces is None:
        faces = _read_arrays(results, record, "prepared", shape).get("faces")
    return _mesh_of(f"form of '{shape}' on {record.data.name}", form.get("vertices"), faces)


def _mesh_of(what: str, vertices: NDArray[Any] | None, faces: NDArray[Any] | None) -> Mesh | None:
    """Return a surface; None if an array is missing, or they are no surface, which is said."""
    if vertices is None or faces is None:
        return None
    try:
        return Mesh(vertices, faces)
    except InvalidMesh as error:
        _say_skipped(f"the stored {what}: {error.problem}; run its job again with --force")
        return None


def read_vertex_map(
    results: Path, record: Record, shape: str
) -> tuple[NDArray[np.int64], bool] | None:
    """Return which vertices of its file a form has.

    Returns
    -------
    numpy.ndarray
        Index of the nearest vertex of the file at each vertex of the form.
    bool
        Whether the form has each vertex of the file once.

    None means that the form has vertices of its own, as those of views have, or is not kept here.
    """
    form = _read_arrays(results, record, "forms", shape)
    prepared = _read_arrays(results, record, "prepared", shape)
    if "vertex_map" not in prepared or "vertices" not in form or "faces" in form:
        return None
    indices = prepared["vertex_map"].astype(np.int64)
    n_vertices = int(prepared["note:vertices_before"])
    has_all = np.array_equal(np.sort(indices), np.arange(n_vertices))
    return indices, has_all


def _read_arrays(
    results: Path, record: RankedShapes, stage: Stage, shape: str
) -> dict[str, NDArray[Any]]:
    """Return arrays of the first view of a shape; none if they are not kept here."""
    keys_of_first_views = record.files.get(stage, [])[:: record.views]
    key_of_shape = dict(zip(record.shapes, keys_of_first_views, strict=False))
    return _read_cached(results, stage, key_of_shape.get(shape, ""), _READ)


def _read_cached(
    results: Path, stage: Stage, key: str, names: Collection[str]
) -> dict[str, NDArray[Any]]:
    """Return arrays of a cached file; none if it is not kept here.

    One that is damaged, or cannot be read, is named on stderr.
    """
    cache = Cache(results)
    try:
        arrays = cache.read(stage, key, only=names)
    except UnreadableFile as error:
        _say_skipped(error.problem)
        return {}
    if arrays is None and cache.has(stage, key):
        path = results / RUNS / stage / f"{key}.npz"
        _say_skipped(f"{path}: it is damaged; run its job again with --force")
    return arrays or {}

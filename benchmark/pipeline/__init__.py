"""From a shape to the record of a row: prepared shapes, forms, distances and scores, and where they are kept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from benchmark.geometry.mesh import Mesh
    from benchmark.pipeline.records import Record


def read_distances(results: Path, record: Record) -> NDArray[np.float64] | None:
    """Return the distances of the shapes with a result, shape (n, n), means over draws; None if not kept here."""
    from benchmark.pipeline.cache import Cache

    arrays = Cache(results).read("records", record.key)
    return None if arrays is None else arrays.get("distances")


def read_prepared(results: Path, record: Record, shape: str) -> Mesh | None:
    """Return the prepared surface of a shape of a record; None if it is not kept here, or could not be prepared."""
    from benchmark.geometry.mesh import Mesh

    arrays = _read(results, record, "prepared", shape)
    return Mesh(arrays["vertices"], arrays["faces"]) if "vertices" in arrays else None


def read_form(results: Path, record: Record, shape: str) -> Mesh | None:
    """Return the canonical form of a shape of a record; None if it is not kept here, or there is none."""
    from benchmark.pipeline.stages import mesh_of

    form, prepared = (_read(results, record, kind, shape) for kind in ("forms", "prepared"))
    return mesh_of(form, prepared) if "vertices" in form and "vertices" in prepared else None


def _read(results: Path, record: Record, kind: str, shape: str) -> dict[str, NDArray[Any]]:
    from benchmark.pipeline.cache import Cache

    if record.files is None or shape not in record.shapes:
        return {}
    key = getattr(record.files, kind)[record.shapes.index(shape)]
    return Cache(results).read(kind, key) or {}  # type: ignore[arg-type]

"""STL, ascii or binary, as vertices and 0-based triangles."""

from __future__ import annotations

import numpy as np

from benchmark.geometry.formats.parsing import Arrays, content_lines, table

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> Arrays:
    """Read STL, ascii or binary; corners at exactly the same position become one vertex."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + _FACET.itemsize * count:
        corners = np.frombuffer(data, _FACET, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid" and b"vertex" in data:
        lines = content_lines(data)
        if not lines[-1].startswith(b"endsolid"):
            raise ValueError("it does not end with 'endsolid'")
        corners = table([line[7:] for line in lines if line.startswith((b"vertex ", b"vertex\t"))])
        if len(corners) % 3 or len(corners) != 3 * sum(line.startswith(b"endfacet") for line in lines):
            raise ValueError("a facet has not three vertices or does not end")
        if corners.shape[1] != 3:
            raise ValueError("a vertex has not three coordinates")
    else:
        raise ValueError(f"{len(data)} bytes are neither an ascii STL nor a binary one of {count} triangles")
    corners = corners + 0.0  # -0.0 and 0.0 are one position
    _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return corners[np.sort(first)], rank[inverse.reshape(-1)].reshape(-1, 3).astype(np.int64)

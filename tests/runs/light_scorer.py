"""A scorer for tests whose scores do not matter: far cheaper than those of the suite and of the
examples, and without torch and scipy, so that its process starts sooner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from benchmark.api import Mesh, ScorerInfo, SignatureArrays
from benchmark.errors import InvalidMesh


@dataclass(frozen=True, kw_only=True)
class Light:
    """Histogram of the distances of vertices from their centre, each counted by its area."""

    info: ClassVar[ScorerInfo] = ScorerInfo(name="light", title="Light")

    def signature(self, form: Mesh) -> SignatureArrays:
        corners = np.repeat(form.face_areas / 3, 3)
        areas = np.bincount(form.faces.ravel(), corners, minlength=form.n_vertices)
        weights = areas / areas.sum() if areas.sum() > 0 else areas
        distances = np.linalg.norm(form.vertices - weights @ form.vertices, axis=1)
        mean = weights @ distances
        if not mean > 0:
            raise InvalidMesh("the form has no extent", "return positions that differ")
        shares, _ = np.histogram(distances / mean, 64, range=(0, 3), weights=weights)
        return {"shares": shares}

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        shares = np.array([signature["shares"] for signature in signatures])
        return np.abs(shares[:, None] - shares).sum(axis=2)

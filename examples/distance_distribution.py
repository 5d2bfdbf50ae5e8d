"""Distance Distribution: how often two points of a form lie how far apart, in a straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist, pdist

from benchmark.api import Interval, Mesh, ScorerInfo, SignatureArrays
from benchmark.errors import InvalidMesh

#: Distances beyond so many times the mean are left out.
LARGEST = 3.0


@dataclass(frozen=True, kw_only=True)
class DistanceDistribution:
    """Histogram of the distances between points of the surface.

    It is the shape distribution D2 of Osada et al. (2002).

    Parameters
    ----------
    bins
        Bins of the histogram, at least 2.
    """

    info: ClassVar[ScorerInfo] = ScorerInfo(
        name="distance-distribution",
        title="Distance Distribution",
        summary="histogram of straight distances between points of a form",
    )

    bins: Annotated[int, Interval(2)] = 64

    def signature(self, form: Mesh) -> SignatureArrays:
        """Return the histogram of distances over their mean; each vertex counts by its area."""
        areas = np.bincount(
            form.faces.ravel(), np.repeat(form.face_areas / 3, 3), minlength=form.n_vertices
        )
        weights = (areas[:, None] * areas)[np.triu_indices(form.n_vertices, 1)]
        distances = pdist(form.vertices)
        mean = weights @ distances / weights.sum() if weights.sum() > 0 else 0.0
        if not mean > 0:
            raise InvalidMesh("the form has no extent", "return positions that differ")
        counts, _ = np.histogram(distances / mean, self.bins, range=(0, LARGEST), weights=weights)
        return {"shares": counts / weights.sum()}

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """Return the sums of differences of histograms, shape (N, N); ``draw`` has no effect."""
        shares = np.array([signature["shares"] for signature in signatures])
        return cdist(shares, shares, "cityblock")

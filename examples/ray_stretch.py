"""Ray Stretch: move each vertex as far from the middle as its path along the surface is long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api import CanonicalForm, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class RayStretch:
    """Push vertices outwards along rays from the geodesic centre, which straightens bent limbs.

    Parameters
    ----------
    strength
        Not negative. 0 leaves the shape as it is; 1 puts each vertex at its geodesic distance from
        the centre.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="ray-stretch",
        title="Ray Stretch",
        summary="vertices at their geodesic distance from the centre",
    )

    strength: Annotated[float, Interval(0)] = 1.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the pushed vertices; the centre is the vertex nearest to all along the surface."""
        geodesics = shape.geodesics()
        centre = int(geodesics.sum(axis=1).argmin())
        rays = shape.mesh.vertices - shape.mesh.vertices[centre]
        straight = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
        stretch = 1 + self.strength * (geodesics[centre] / straight - 1)
        return shape.form(rays * stretch[:, None], largest_stretch=float(stretch.max()))

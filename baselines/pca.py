"""PCA: the input in the frame of its principal axes, without its rotation but with its pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baselines._kernels.checks import require_vertices
from baselines._kernels.orientation import canonical_signs, vertex_areas
from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class PCA:
    """Surface rotated to its principal axes, largest variance first.

    A control: with the frame fixed, two shapes differ only in subject and pose. Variances are weighted by vertex area,
    so that the frame depends on the surface and not on its sampling. The first two axes point to the side of positive
    third moment, and the third completes a right-handed frame: the form is a rotation of the input, never a mirror
    image. There is no whitening.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="pca",
        title="PCA",
        family="control",
        summary="the input turned into its principal axes",
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the centred vertices in the frame of the principal axes.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices or no face.
        """
        require_vertices(shape)
        areas = vertex_areas(shape.mesh)
        centred = shape.mesh.vertices - np.average(shape.mesh.vertices, axis=0, weights=areas)
        variances, axes = np.linalg.eigh((centred * areas[:, None]).T @ centred / areas.sum())
        axes = axes[:, ::-1]
        axes = axes * canonical_signs(centred @ axes, areas, shape.mesh.vertices)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        largest = float(variances[2])
        return shape.form(
            centred @ axes,
            variance_ratio_2=float(variances[1]) / largest,
            variance_ratio_3=float(variances[0]) / largest,
        )

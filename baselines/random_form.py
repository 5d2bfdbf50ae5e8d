"""Random positions: the lower bound of every table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class RandomForm:
    """Independent normal positions of the vertices, joined by the triangles of the shape.

    A control: any score above chance level comes from the number of vertices and triangles, or from a fault of the
    scorer. Centre and root-mean-square radius are those of the shape, so that size gives no advantage over other rows.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="random",
        title="Random form",
        family="control",
        summary="random positions over the triangles of the shape",
        deterministic=False,
    )

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return normal positions drawn from the shape's own generator."""
        vertices = shape.mesh.vertices
        centre = vertices.mean(axis=0)
        radius = np.sqrt(((vertices - centre) ** 2).sum(axis=1).mean())
        positions = shape.random("random form").standard_normal(vertices.shape)
        return shape.form(centre + positions * (radius / np.sqrt(3)))

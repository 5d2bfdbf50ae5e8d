"""Surface area: one number per shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import FloatArray, MethodInfo, Shape, UnsupportedShape

#: Largest relative difference of two areas that rounding alone explains.
EQUAL_AREAS = 1e-9


@dataclass(frozen=True, kw_only=True)
class SurfaceArea:
    """Area of the surface in the file, before decimation and scaling.

    A control: bending preserves the area. If all files share one unit of length, this single number
    may retrieve subjects well, and a row below it finds them no better than their size does. Shapes
    are compared by absolute difference. Areas that differ by rounding are equal, so that a set
    whose surfaces were all given one area is at chance.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="surface-area",
        title="Surface area",
        family="control",
        summary="Compares nothing but the surface area, in the units of the files.",
    )

    def describe(self, shape: Shape) -> FloatArray:
        """Return the area in squared file units, shape (1,).

        Raises
        ------
        UnsupportedShape
            If the area before preparation is not known.
        """
        if shape.source_area is None:
            raise UnsupportedShape(
                f"{shape.identifier}: the area before scaling is not known",
                "load the shape from its mesh file",
            )
        return np.array([shape.source_area])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the absolute differences of the areas, shape (N, N)."""
        return self.compare_to(descriptors, descriptors)

    def compare_to(
        self, queries: Sequence[FloatArray], gallery: Sequence[FloatArray], draw: int = 0
    ) -> FloatArray:
        """Return those of M queries to N shapes, shape (M, N)."""
        rows = np.reshape(queries, (-1, 1))
        columns = np.reshape(gallery, (1, -1))
        differences = np.abs(rows - columns)
        is_rounding = differences <= EQUAL_AREAS * np.maximum(rows, columns)
        return np.where(is_rounding, 0.0, differences)

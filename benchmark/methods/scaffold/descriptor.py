"""A descriptor to start from, and its test."""

from string import Template

PLUGIN = Template('''\
"""$title: how far the points of a surface are from all others, along the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from scipy.spatial.distance import cdist

from benchmark.contracts import FloatArray, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class $class_name:
    """Quantiles, over the area of the surface, of the mean geodesic distance of a point to all others.

    Parameters
    ----------
    count
        Numbers in a descriptor, at least 1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="$name",
        title="$title",
        summary="quantiles of the mean geodesic distance",
    )

    count: Annotated[int, Interval(1)] = 50

    def describe(self, shape: Shape) -> FloatArray:
        """Return the quantiles, shape (count,); each vertex counts by its area, so that the mesh does not matter."""
        area = shape.laplacian().mass
        means = shape.geodesics() @ area / area.sum()
        order = np.argsort(means)
        below = np.cumsum(area[order]) - area[order] / 2
        levels = (np.arange(self.count) + 0.5) / self.count
        return np.interp(levels * area.sum(), below, means[order])

    def distances(self, descriptors: Sequence[FloatArray]) -> FloatArray:
        """Return the sums of the differences of quantiles, for all pairs, shape (N, N)."""
        return cdist(descriptors, descriptors, "cityblock")
''')

TEST = Template('''\
"""What $title promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.contracts import Shape
from benchmark.methods.conformance import check_target, figure
from benchmark.methods.registry import plugin_methods

PLUGIN = Path(__file__).with_name("$module.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\\n{report}"


def test_a_quantile_of_one_half_is_the_mean_of_a_vertex_in_the_middle() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    area = shape.laplacian().mass
    means = shape.geodesics() @ area / area.sum()
    (half,) = spec.load()(count=1).describe(shape)
    assert means.min() < half < means.max()
    assert abs(area[means < half].sum() / area.sum() - 0.5) < 0.01
    distances = spec.create().distances([np.zeros(50), np.ones(50)])
    np.testing.assert_allclose(distances, [[0, 50], [50, 0]])
''')

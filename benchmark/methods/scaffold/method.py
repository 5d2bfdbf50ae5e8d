"""A method to start from, and its test."""

from string import Template

PLUGIN = Template('''\
"""$title: every vertex as far from the middle of the surface as the way along the surface is long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.contracts import CanonicalForm, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class $class_name:
    """Vertices pushed outwards along the rays from the geodesic centre, which stretches bent limbs.

    Parameters
    ----------
    strength
        Not negative. 0 leaves the shape as it is; 1 puts each vertex at its geodesic distance from the centre.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="$name",
        title="$title",
        summary="vertices at their geodesic distance from the centre",
    )

    strength: Annotated[float, Interval(0)] = 1.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the pushed vertices; the centre is the vertex nearest to all others along the surface."""
        geodesics = shape.geodesics()
        centre = int(geodesics.sum(axis=1).argmin())
        rays = shape.mesh.vertices - shape.mesh.vertices[centre]
        straight = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
        stretch = 1 + self.strength * (geodesics[centre] / straight - 1)
        return shape.form(rays * stretch[:, None], largest_stretch=float(stretch.max()))
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


def test_vertices_lie_at_their_geodesic_distance_from_the_centre() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    form = spec.load()(strength=1.0).canonicalise(shape)
    geodesics = shape.geodesics()
    centre = geodesics.sum(axis=1).argmin()
    distances = np.linalg.norm(form.vertices - form.vertices[centre], axis=1)
    np.testing.assert_allclose(distances, geodesics[centre], atol=1e-9)
''')

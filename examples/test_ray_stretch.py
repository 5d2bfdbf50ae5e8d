"""What Ray Stretch promises."""

from __future__ import annotations

import numpy as np
from ray_stretch import RayStretch

from benchmark.api import Shape
from benchmark.check import failures
from benchmark.check.shapes import figure


def test_it_keeps_the_contract() -> None:
    assert not failures(RayStretch)


def test_vertices_lie_at_their_geodesic_distance_from_the_centre() -> None:
    shape = Shape(identifier="figure", mesh=figure())
    form = RayStretch(strength=1.0).canonicalise(shape)
    geodesics = shape.geodesics()
    centre = geodesics.sum(axis=1).argmin()
    distances = np.linalg.norm(form.vertices - form.vertices[centre], axis=1)
    np.testing.assert_allclose(distances, geodesics[centre], atol=1e-9)

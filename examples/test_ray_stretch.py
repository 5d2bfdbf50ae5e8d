"""What Ray Stretch promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.api import Shape
from benchmark.plugins.conformance import check_target, figure
from benchmark.plugins.registry import plugin_methods

PLUGIN = Path(__file__).with_name("ray_stretch.py")


def test_it_keeps_the_contract() -> None:
    report = check_target(str(PLUGIN))
    assert report, f"\n{report}"


def test_vertices_lie_at_their_geodesic_distance_from_the_centre() -> None:
    (spec,) = plugin_methods(PLUGIN)
    shape = Shape(identifier="figure", mesh=figure())
    form = spec.load()(strength=1.0).canonicalise(shape)
    geodesics = shape.geodesics()
    centre = geodesics.sum(axis=1).argmin()
    distances = np.linalg.norm(form.vertices - form.vertices[centre], axis=1)
    np.testing.assert_allclose(distances, geodesics[centre], atol=1e-9)

import numpy as np
import pytest

from baselines.surface_area import SurfaceArea
from benchmark.api.contracts import Descriptor, Shape, UnsupportedShape
from tests.baselines.embedding import sphere


def test_two_shapes_differ_by_the_difference_of_their_areas():
    mesh = sphere(50)
    shapes = [Shape(identifier=str(area), mesh=mesh, source_area=area) for area in (2.0, 5.0, 4.5)]
    distances = SurfaceArea().distances([SurfaceArea().describe(shape) for shape in shapes])
    np.testing.assert_array_equal(distances, [[0, 3, 2.5], [3, 0, 0.5], [2.5, 0.5, 0]])
    assert isinstance(SurfaceArea(), Descriptor)


def test_an_unknown_area_is_not_taken_from_the_scaled_mesh():
    with pytest.raises(UnsupportedShape, match="area before scaling"):
        SurfaceArea().describe(Shape(identifier="ball", mesh=sphere(50)))

import numpy as np

from benchmark.geometry.remeshing import isotropic_remesh
from tests.geometry.surfaces import sphere


def test_a_call_does_not_depend_on_the_calls_before_it():
    """The library behind it remembers parameters between calls."""
    first = isotropic_remesh(sphere(3), 0.2, iterations=5, feature_degrees=60, max_deviation=1.0)
    isotropic_remesh(sphere(2), 0.3, iterations=1, feature_degrees=10)
    again = isotropic_remesh(sphere(3), 0.2, iterations=5, feature_degrees=60, max_deviation=1.0)
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)

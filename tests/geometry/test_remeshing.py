import numpy as np

from benchmark.geometry.remeshing import isotropic_remesh
from tests.geometry.surfaces import sphere


def test_edges_come_out_near_the_wanted_length():
    mesh = isotropic_remesh(sphere(3), 0.2, iterations=5, feature_degrees=60, max_deviation=1.0)
    edges = np.linalg.norm(mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)], axis=2)
    assert abs(np.median(edges) / 0.2 - 1) < 0.15
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 0.03


def test_a_call_does_not_depend_on_the_calls_before_it():
    """The library behind it remembers parameters between calls."""
    first = isotropic_remesh(sphere(3), 0.2, iterations=5, feature_degrees=60, max_deviation=1.0)
    isotropic_remesh(sphere(2), 0.3, iterations=1, feature_degrees=10)
    again = isotropic_remesh(sphere(3), 0.2, iterations=5, feature_degrees=60, max_deviation=1.0)
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)

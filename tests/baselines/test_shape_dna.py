import numpy as np

from baselines.shape_dna import ShapeDNA
from benchmark.api.contracts import Descriptor, Shape
from tests.baselines.embedding import sphere


def test_the_spectrum_of_a_sphere():
    # Eigenvalues l (l + 1), each 2 l + 1 times, times the area 4 pi, whatever the radius.
    mesh = sphere(2000)
    expected = 4 * np.pi * np.array([2] * 3 + [6] * 5 + [12] * 4)
    for radius in (1, 5):
        found = ShapeDNA().describe(Shape(identifier="sphere", mesh=mesh.with_vertices(radius * mesh.vertices)))
        np.testing.assert_allclose(found, expected, rtol=0.02)


def test_distances_are_euclidean():
    distances = ShapeDNA().distances([np.array([0.0, 3]), np.array([4.0, 0]), np.array([0.0, 3])])
    np.testing.assert_allclose(distances, [[0, 5, 0], [5, 0, 5], [0, 5, 0]])
    assert isinstance(ShapeDNA(), Descriptor)

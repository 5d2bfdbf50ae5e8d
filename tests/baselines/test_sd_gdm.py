import numpy as np

from baselines.sd_gdm import SDGDM
from benchmark.api.contracts import Descriptor
from tests.baselines.embedding import PointShape, limbed, points_on_ellipsoid


def test_equal_distances_have_a_known_spectrum():
    # The matrix of ones without its diagonal: n - 1 once and -1 otherwise.
    points = points_on_ellipsoid(60)
    found = SDGDM(count=5).describe(PointShape(points, np.ones((60, 60)) - np.eye(60)))
    np.testing.assert_allclose(found, np.array([59, 1, 1, 1, 1]) / 63, atol=1e-10)


def test_singular_values_agree_with_a_full_decomposition():
    shape = limbed()
    expected = np.linalg.svd(shape.geodesics(), compute_uv=False)[:20]
    np.testing.assert_allclose(SDGDM().describe(shape), expected / expected.sum(), rtol=1e-9)


def test_distances_by_hand():
    distances = SDGDM().distances([np.array([0.6, 0.4]), np.array([0.2, 0.8])])
    np.testing.assert_allclose(distances, [[0, 1 + 2 / 3], [1 + 2 / 3, 0]])
    assert isinstance(SDGDM(), Descriptor)

import numpy as np

from baselines.euclidean_distance import EuclideanDistance
from tests.baselines.deformable import shape_of
from tests.baselines.embedding import sphere


def test_an_even_surface_without_tips_pushes_points_all_over_it():
    form = EuclideanDistance(points="local").canonicalise(shape_of(sphere(800)))
    assert form.notes["points"] > 1
    assert np.isfinite(form.vertices).all()

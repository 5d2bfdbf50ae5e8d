"""Our scalings beside those of scikit-learn, over the same distances."""

import numpy as np
import pytest
from sklearn.manifold import ClassicalMDS, Isomap, smacof

from baselines.classic_mds import ClassicMDS, classic_scaling
from baselines.least_squares_mds import LeastSquaresMDS
from tests.baselines.embedding import brute_force_stress, limbed, spread


@pytest.fixture(scope="module")
def shape():
    return limbed(300)


def test_classic_scaling_is_that_of_the_library(shape):
    ours, ratios = classic_scaling(shape.geodesics())
    theirs = ClassicalMDS(n_components=3, metric="precomputed")
    np.testing.assert_allclose(spread(theirs.fit_transform(shape.geodesics())), spread(ours), atol=1e-6)
    np.testing.assert_allclose(theirs.eigenvalues_ / theirs.eigenvalues_[0], ratios[:3], rtol=1e-6)


def test_least_squares_scaling_comes_to_rest_no_higher_than_the_library(shape):
    distances, start = shape.geodesics(), shape.mesh.vertices
    options = {"n_components": 3, "n_init": 1, "max_iter": 300, "eps": 1e-6, "normalized_stress": False}
    theirs, _ = smacof(distances, init=start, **options)
    assert LeastSquaresMDS().canonicalise(shape).notes["stress"] < 1.01 * brute_force_stress(theirs, distances)


def test_with_all_vertices_as_neighbours_isomap_is_classic_scaling(shape):
    isomap = Isomap(n_neighbors=299, n_components=3, metric="precomputed", eigen_solver="dense")
    points = isomap.fit_transform(shape.geodesics())
    np.testing.assert_allclose(spread(points), spread(ClassicMDS().canonicalise(shape).vertices), atol=1e-6)

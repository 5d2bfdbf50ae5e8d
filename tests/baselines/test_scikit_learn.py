"""Our scalings beside those of scikit-learn, over the same distances."""

import numpy as np
import pytest

from baselines.classic_mds import ClassicMDS
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.scikit_learn_classical_mds import ScikitLearnClassicalMDS
from baselines.scikit_learn_isomap import ScikitLearnIsomap
from baselines.scikit_learn_smacof import ScikitLearnSMACOF
from tests.baselines.embedding import brute_force_stress, limbed


@pytest.fixture(scope="module")
def shape():
    return limbed(300)


def test_classic_scaling_is_that_of_the_library(shape):
    ours, theirs = (method().canonicalise(shape) for method in (ClassicMDS, ScikitLearnClassicalMDS))
    np.testing.assert_allclose(theirs.vertices, ours.vertices, atol=1e-6)
    assert theirs.notes["eigenvalue_ratio_3"] == pytest.approx(ours.notes["eigenvalue_ratio_3"], rel=1e-6)
    assert theirs.notes["handedness"] == pytest.approx(ours.notes["handedness"], abs=1e-5)


def test_least_squares_scaling_comes_to_rest_no_higher_than_the_library(shape):
    ours, theirs = (method().canonicalise(shape) for method in (LeastSquaresMDS, ScikitLearnSMACOF))
    assert theirs.notes["stress"] == pytest.approx(brute_force_stress(theirs.vertices, shape.geodesics()))
    assert theirs.notes["iterations"] <= 300
    assert ours.notes["stress"] < 1.01 * theirs.notes["stress"]


def test_with_all_vertices_as_neighbours_isomap_is_classic_scaling(shape):
    form = ScikitLearnIsomap(neighbours=299).canonicalise(shape)
    np.testing.assert_allclose(form.vertices, ClassicMDS().canonicalise(shape).vertices, atol=1e-6)

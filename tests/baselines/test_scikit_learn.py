"""Our scalings beside those of scikit-learn, over the same distances."""

import numpy as np
import pytest

from baselines.classic_mds import ClassicMDS
from baselines.least_squares_mds import LeastSquaresMDS
from baselines.scikit_learn_classical_mds import ScikitLearnClassicalMDS
from baselines.scikit_learn_isomap import ScikitLearnIsomap
from baselines.scikit_learn_smacof import ScikitLearnSMACOF
from tests.baselines.deformable import shape_of, sheet
from tests.baselines.embedding import PointShape, assert_contract, brute_force_stress, limbed, sphere, spread

WITNESSES = (ScikitLearnClassicalMDS, ScikitLearnSMACOF, ScikitLearnIsomap)


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


def test_paths_through_near_neighbours_are_longer(shape):
    few, all_ = (ScikitLearnIsomap(neighbours=count).canonicalise(shape).vertices for count in (6, 299))
    assert spread(few).max() > spread(all_).max()


def test_isomap_unrolls_a_sheet():
    flat, rolled = (ScikitLearnIsomap().canonicalise(shape_of(sheet(bend=bend))).vertices for bend in (0.0, 2.0))
    assert np.abs(spread(rolled) - spread(flat)).max() < 0.02 * spread(flat).max()


def test_points_in_space_are_recovered():
    points = sphere(100).vertices * [3.0, 2.0, 1.0]
    for method in (ScikitLearnClassicalMDS(), ScikitLearnIsomap(neighbours=99)):
        np.testing.assert_allclose(spread(method.canonicalise(PointShape(points)).vertices), spread(points), atol=1e-6)


@pytest.mark.parametrize("method", WITNESSES)
def test_contract(method):
    assert_contract(method(), limbed(200), atol=1e-4)


def test_of_few_vertices_isomap_joins_all():
    shape = limbed(10)
    form = ScikitLearnIsomap().canonicalise(shape)
    np.testing.assert_allclose(form.vertices, ClassicMDS().canonicalise(shape).vertices, atol=1e-6)

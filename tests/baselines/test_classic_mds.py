"""Classic scaling and GPS where their values are known, and the one rule for signs and mirror
images.
"""

import numpy as np
import pytest
from sklearn.manifold import ClassicalMDS, Isomap

from baselines.accelerated_mds import AcceleratedMDS
from baselines.classic_mds import ClassicMDS, classic_scaling
from baselines.gps import GPS
from baselines.shape_dna import ShapeDNA
from baselines.si_hks import ScaleInvariantHKS
from benchmark.api import oriented
from benchmark.api.contracts import Mesh, Shape, UnsupportedShape
from tests.baselines.embedding import limbed, sphere, spread
from tests.geometry.surfaces import joined


def test_negative_eigenvalues_count_as_zero():
    # Four corners of a square with shortest paths along its sides: eigenvalues 2, 2, 0 and -1 by
    # hand.
    ring = np.array([[0, 1, 2, 1], [1, 0, 1, 2], [2, 1, 0, 1], [1, 2, 1, 0]], dtype=float)
    points, values = classic_scaling(ring)
    np.testing.assert_allclose(values, [2, 2, 0, -1], atol=1e-12)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-7)
    np.testing.assert_allclose(spread(points)[0], [0, np.sqrt(2), 2, np.sqrt(2)], atol=1e-7)


def test_a_large_negative_eigenvalue_displaces_no_positive_one():
    random = np.random.default_rng(1).standard_normal((100, 99))
    axes = np.linalg.qr(np.column_stack([np.ones(100), random]))[0][:, 1:]
    gram = axes * [5, 4, 3, 2, -12, *np.linspace(-1, 1, 94)] @ axes.T
    squares = (
        gram.diagonal() + gram.diagonal()[:, None] - 2 * gram + 4 * (1 - np.eye(100))
    )  # adds 2 to the eigenvalues
    np.testing.assert_allclose(classic_scaling(np.sqrt(squares))[1], [7, 6, 5, 4], rtol=1e-9)


def test_classic_scaling_is_that_of_scikit_learn_and_isomap_of_all_neighbours():
    shape = limbed(300)
    form = ClassicMDS().canonicalise(shape)
    theirs = ClassicalMDS(n_components=3, metric="precomputed")
    np.testing.assert_allclose(
        spread(theirs.fit_transform(shape.geodesics())), spread(form.vertices), atol=1e-6
    )
    assert form.notes["eigenvalue_ratio_3"] == pytest.approx(
        theirs.eigenvalues_[2] / theirs.eigenvalues_[0], rel=1e-6
    )
    isomap = Isomap(n_neighbors=299, n_components=3, metric="precomputed", eigen_solver="dense")
    np.testing.assert_allclose(
        spread(isomap.fit_transform(shape.geodesics())), spread(form.vertices), atol=1e-6
    )


def test_signs_of_an_eigensolver_and_a_mirror_image_change_nothing():
    points, weights = (
        limbed(200).mesh.vertices * [3.0, 2.0, 1.0],
        np.random.default_rng(0).uniform(0.5, 1.5, 200),
    )
    expected = oriented(points, weights)
    centred = expected - weights @ expected / weights.sum()
    assert (weights @ centred[:, :2] ** 3 > 0).all()
    assert weights @ centred.prod(axis=1) > 0
    for signs in np.ndindex(2, 2, 2):
        np.testing.assert_allclose(
            oriented(points * (1 - 2 * np.array(signs)), weights), expected, atol=1e-12
        )


def test_gps_of_a_sphere_is_a_sphere():
    # Eigenvalue 2 three times; the three functions have squares that sum to 3 / (4 pi), over 2
    # gives the radius.
    form = GPS().canonicalise(Shape(identifier="sphere", mesh=sphere(1500)))
    np.testing.assert_allclose(
        np.linalg.norm(form.vertices, axis=1), np.sqrt(3 / (8 * np.pi)), rtol=0.02
    )
    assert form.notes["eigenvalue_1"] == pytest.approx(8 * np.pi, rel=0.01)
    assert form.notes["eigenvalue_gap_12"] == pytest.approx(0, abs=0.02)
    assert form.notes["eigenvalue_gap_34"] == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize("method", [GPS(), AcceleratedMDS(), ShapeDNA(), ScaleInvariantHKS()])
def test_balls_that_a_triangle_without_area_joins_are_refused_by_name(method):
    ball = sphere(150)
    balls = joined(ball, ball.with_vertices(ball.vertices + np.array([3.0, 0.0, 0.0])))
    apply = getattr(method, "canonicalise", None) or method.describe
    with pytest.raises(UnsupportedShape, match="second eigenvalue of the Laplacian is zero"):
        apply(Shape(identifier="balls", mesh=Mesh(balls.vertices, [*balls.faces, [0, 0, 150]])))

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.manifold import smacof as sklearn_smacof

from baselines._kernels.orientation import vertex_areas
from baselines._kernels.smacof import attractions, normalised_stress, smacof
from baselines.least_squares_mds import LeastSquaresMDS
from benchmark.errors import ConfigurationError
from tests.baselines.embedding import (
    PointShape,
    assert_contract,
    brute_force_stress,
    limbed,
    moved,
    points_on_ellipsoid,
    spread,
)

pytestmark = pytest.mark.kernels


def random_problem(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    distances = spread(generator.standard_normal((n, 5))) ** 0.8
    return distances, generator.standard_normal((n, 3))


def test_one_transform_by_hand():
    # Two points at distance 2 that should be 6 apart, a third far away that pulls with ratio 1.
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 4, 0]])
    distances = spread(points)
    distances[0, 1] = distances[1, 0] = 6
    sums = attractions(np.ascontiguousarray(points.T), distances)
    # b = 3 (x0 - x1) + (x0 - x2) for the first, and so on.
    np.testing.assert_allclose(sums.T, [[-7, -4, 0], [7, -4, 0], [0, 8, 0]])


@pytest.mark.parametrize("seed", range(3))
def test_positions_agree_with_scikit_learn_step_by_step(seed):
    distances, start = random_problem(seed)
    start -= start.mean(axis=0)
    for iterations in (1, 25):
        expected, raw, _ = sklearn_smacof(
            distances, n_components=3, init=start, n_init=1, max_iter=iterations, eps=0, return_n_iter=True
        )
        found = smacof(distances, start, max_iterations=iterations, rtol=0)
        np.testing.assert_allclose(found.points, expected, atol=1e-10)
        assert found.stress[-1] == pytest.approx(raw / (distances**2).sum() * 2, rel=1e-9)


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.booleans())
def test_the_stress_never_rises_with_or_without_weights(seed, weighted):
    distances, start = random_problem(seed, 30)
    weights = np.random.default_rng(seed).random((30, 30)) ** 3
    course = smacof(
        distances, start, weights=weights + weights.T if weighted else None, max_iterations=30, rtol=0
    ).stress
    assert (np.diff(course) <= 1e-12).all()
    assert course[-1] < course[0]


def test_a_weighted_transform_agrees_with_the_pseudo_inverse():
    distances, start = random_problem(1, 20)
    weights = np.random.default_rng(1).random((20, 20))
    weights = weights + weights.T
    np.fill_diagonal(weights, 0)
    laplacian = np.diag(weights.sum(axis=1)) - weights
    ratios = weights * distances / (spread(start) + np.eye(20))
    transform = np.linalg.pinv(laplacian) @ (np.diag(ratios.sum(axis=1)) - ratios) @ start
    found = smacof(distances, start, weights=weights, max_iterations=1, rtol=0)
    np.testing.assert_allclose(found.points, transform, atol=1e-10)
    stress = (weights * (spread(found.points) - distances) ** 2).sum() / (weights * distances**2).sum()
    assert found.stress[-1] == pytest.approx(stress, rel=1e-9)


def test_equal_weights_change_nothing():
    distances, start = random_problem(2)
    plain = smacof(distances, start, max_iterations=10, rtol=0)
    weighted = smacof(distances, start, weights=np.full_like(distances, 0.3), max_iterations=10, rtol=0)
    np.testing.assert_allclose(weighted.points, plain.points, atol=1e-10)
    np.testing.assert_allclose(weighted.stress, plain.stress, rtol=1e-9)


def test_the_stress_is_that_of_the_definition_wherever_the_points_lie():
    distances, points = random_problem(3)
    assert normalised_stress(points + 100, distances) == pytest.approx(brute_force_stress(points, distances), rel=1e-8)


def test_coincident_points_do_no_harm():
    distances, start = random_problem(4)
    start[:5] = start[0]
    result = smacof(distances, start, max_iterations=20, rtol=0)
    assert np.isfinite(result.points).all()
    assert (np.diff(result.stress) <= 1e-12).all()


def test_points_in_space_are_a_fixed_point():
    points = points_on_ellipsoid()
    form = LeastSquaresMDS().canonicalise(PointShape(points))
    np.testing.assert_allclose(form.vertices, points - points.mean(axis=0), atol=1e-10)
    assert form.notes["stress"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("start", ["mesh", "classic"])
def test_both_starts_lower_the_stress_and_say_so(start):
    shape = limbed()
    form = LeastSquaresMDS(start=start).canonicalise(shape)
    assert form.notes["stress"] == pytest.approx(brute_force_stress(form.vertices, shape.geodesics()), rel=1e-8)
    assert form.notes["stress"] < 0.8 * form.notes["stress_of_start"]
    assert 1 < form.notes["iterations"] <= 100


def test_the_form_from_the_mesh_turns_with_the_mesh_and_the_one_from_classic_scaling_does_not():
    shape = limbed()
    turned = moved(shape)
    for start, follows in (("mesh", True), ("classic", False)):
        form, other = (LeastSquaresMDS(start=start).canonicalise(each).vertices for each in (shape, turned))
        assert (np.abs(form - other).max() > 0.1) == follows


def test_area_weights_lower_the_stress_over_the_surface():
    shape = limbed()
    areas = vertex_areas(shape.mesh)
    weights = np.outer(areas, areas)
    residuals = {}
    for kind in ("uniform", "area"):
        form = LeastSquaresMDS(weights=kind, rtol=0).canonicalise(shape)
        residuals[kind] = (weights * (spread(form.vertices) - shape.geodesics()) ** 2).sum()
    assert residuals["area"] < residuals["uniform"]


def test_unknown_options_are_refused():
    with pytest.raises(ConfigurationError, match="did you mean area"):
        LeastSquaresMDS(weights="aera")  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="did you mean mesh"):
        LeastSquaresMDS(start="mech")  # type: ignore[arg-type]


def test_contract():
    assert_contract(LeastSquaresMDS(), limbed())
    assert_contract(LeastSquaresMDS(start="classic"), limbed())

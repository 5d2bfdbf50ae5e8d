import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.distance import pdist

from baselines._kernels.conformal import angle_defects, conformal_factors, tips
from baselines._kernels.springs import Springs
from baselines.euclidean_distance import EuclideanDistance
from tests.baselines.deformable import (
    centre_line,
    check_real_body,
    shape_of,
    straightness,
    tube,
)
from tests.baselines.embedding import limbed, sphere


def energy_by_definition(mesh, positions, points, push):
    pairs = {tuple(sorted(side)) for face in mesh.faces for side in zip(face, np.roll(face, 1), strict=True)}
    total = -push * pdist(positions[points]).sum()
    for i, j in pairs:
        rest = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j])
        total += 0.5 * (np.linalg.norm(positions[i] - positions[j]) - rest) ** 2
    return total


def test_the_energy_is_that_of_the_definition_and_never_rises():
    mesh, points, push = limbed(150).mesh, [3, 50, 90, 140], 0.02
    springs = Springs.of(mesh)
    positions, course = mesh.vertices, []
    for _ in range(30):
        course.append(springs.energy(positions, points, push))
        assert course[-1] == pytest.approx(energy_by_definition(mesh, positions, points, push), abs=1e-12)
        positions = springs.relax(positions, points, push, 1)
    assert (np.diff(course) <= 1e-12).all()
    assert course[-1] < course[0]


def test_many_steps_reach_the_minimum_that_a_general_minimiser_finds():
    mesh, points, push = limbed(30).mesh, [3, 15, 29], 0.05
    springs = Springs.of(mesh)
    found = springs.relax(mesh.vertices, points, push, 10000)

    def energy(flat):
        return springs.energy(flat.reshape(-1, 3), points, push)

    expected = minimize(energy, found.ravel() + 1e-3 * np.random.default_rng(0).standard_normal(found.size), tol=1e-12)
    assert energy(found.ravel()) == pytest.approx(expected.fun, abs=1e-6)


def test_conformal_factors_solve_their_equation_and_are_those_of_an_even_curvature():
    shape = limbed(200)
    laplacian = shape.laplacian()
    curvature, shares = angle_defects(shape.mesh), laplacian.mass / laplacian.mass.sum()
    expected = np.linalg.lstsq(laplacian.stiffness.toarray(), curvature - curvature.sum() * shares, rcond=None)[0]
    found = conformal_factors(shape.mesh, laplacian)
    np.testing.assert_allclose(found, expected - shares @ expected, atol=1e-6)
    assert shares @ found == pytest.approx(0, abs=1e-12)
    ball = shape_of(sphere(800))
    assert np.abs(conformal_factors(ball.mesh, ball.laplacian())).max() < 0.02


def test_the_tips_are_the_ends_of_the_limbs():
    shape = limbed(900)
    # Those of the four longer ones: the shortest is a bump that would have to grow less than the surface as a whole.
    directions = np.array([[1, 0.1, 0], [-0.9, 0.3, 0.2], [0.1, -1, 0.2], [0, 0.4, 1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = tips(shape, 30, 0.1)
    away = shape.mesh.vertices[found]
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    assert len(found) == 4
    assert (directions @ away.T).max(axis=1).min() > 0.99
    assert tips(shape, 3, 0.1) == found[:3]
    assert len(tips(shape, 30, 5.0)) == 1


@pytest.mark.parametrize("points", ["global", "local"])
def test_a_bent_tube_straightens_and_its_edges_keep_their_length(points):
    mesh = tube(2.4)
    form = EuclideanDistance(points=points).canonicalise(shape_of(mesh))
    assert straightness(centre_line(mesh.vertices)) < 0.8
    assert straightness(centre_line(form.vertices)) > 0.88
    assert form.notes["growth"] > 1.04
    assert form.notes["mean_edge_strain"] < 0.03
    lengths = Springs.of(mesh)
    assert form.notes["mean_edge_strain"] == pytest.approx(lengths.strains(form.vertices).mean())


def test_an_even_surface_without_tips_pushes_points_all_over_it():
    form = EuclideanDistance(points="local").canonicalise(shape_of(sphere(800)))
    assert form.notes["points"] > 1
    assert np.isfinite(form.vertices).all()


@pytest.mark.data
@pytest.mark.parametrize("points", ["local"])
@pytest.mark.parametrize("name", ["michael6"])
def test_real_bodies_spread_their_limbs(data_root, name, points):
    form = check_real_body(EuclideanDistance(points=points), data_root / "tosca" / f"{name}.off")
    assert form.notes["mean_edge_strain"] <= 0.03


def test_a_surface_that_shrinks_by_its_conformal_factors_is_more_evenly_curved():
    ball = sphere(500)
    mesh = ball.with_vertices(ball.vertices * [2.0, 1.0, 1.0])
    laplacian = shape_of(mesh).laplacian()
    factors = conformal_factors(mesh, laplacian)

    def unevenness(power):
        """How far the curvature is from even where lengths are multiplied by this power of the factors."""
        scale = np.exp(power * factors / 2)
        corners = mesh.vertices[mesh.faces]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
        lengths = lengths * np.roll(scale[mesh.faces], -1, axis=1) * np.roll(scale[mesh.faces], 1, axis=1)
        before, after = np.roll(lengths, 1, axis=1), np.roll(lengths, -1, axis=1)
        angles = np.arccos((before**2 + after**2 - lengths**2) / (2 * before * after))
        shares = laplacian.mass * scale**4 / (laplacian.mass @ scale**4)
        curvature = 2 * np.pi - np.bincount(mesh.faces.ravel(), angles.ravel(), mesh.n_vertices)
        return np.abs(curvature - 4 * np.pi * shares).sum()

    assert unevenness(-1) < 0.5 * unevenness(0) < unevenness(0) < unevenness(1)

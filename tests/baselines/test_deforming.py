"""Forms that deform the surface: beside libigl, from known targets, and with bounded strain."""

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import AsRigidAsPossible, _closed_form, nearest_rotations
from baselines.constrained_mds import ConstrainedMDS
from baselines.feature_preserved import FeaturePreserved
from baselines.mesh_unfolding import MeshUnfolding, repulsion
from tests.baselines.deformable import moved_to, shape_of, sheet, tube
from tests.baselines.embedding import spread

pytestmark = pytest.mark.kernels


def lopsided(mesh):
    """Twist a tube about its own axis, so that no mirror image can be turned into it."""
    x, y, z = mesh.vertices.T
    cosine, sine = np.cos(2.0 * x), np.sin(2.0 * x)
    return mesh.with_vertices(
        np.stack([x, 1.8 * y * cosine - z * sine, 1.8 * y * sine + z * cosine], axis=1)
    )


def test_the_elastic_step_agrees_with_libigl(steps=25):
    mesh = sheet(rows=14, columns=7, bend=0.6)
    surface = AsRigidAsPossible.of(shape_of(mesh))
    handles = np.flatnonzero(
        (mesh.vertices[:, 0] < 0.1) | (mesh.vertices[:, 0] > mesh.vertices[:, 0].max() - 0.1)
    )
    goals = mesh.vertices[handles].copy()
    goals[goals[:, 0] > 0.5] += [-0.2, 0.1, 0.4]
    data = igl.ARAPData()
    data.energy, data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES, steps
    igl.arap_precomputation(
        mesh.vertices, mesh.faces.astype(np.int64), 3, handles.astype(np.int32), data
    )
    expected = igl.arap_solve(goals, data, mesh.vertices.copy())
    # A pull that outweighs the surface by far holds the handles as a hard constraint does.
    pull, targets, positions = (
        np.zeros(mesh.n_vertices),
        np.zeros_like(mesh.vertices),
        mesh.vertices.copy(),
    )
    pull[handles], targets[handles], positions[handles] = 1e7, goals, goals
    solve = surface.factorise(pull)
    for _ in range(steps):
        positions = solve(surface.load(surface.rotations(positions)) + pull[:, None] * targets)
    np.testing.assert_allclose(positions, expected, atol=1e-5 * np.ptp(mesh.vertices))


def test_the_step_solves_for_the_slope_of_the_energy():
    mesh = tube(1.0, rings=8, sides=6)
    surface, random = AsRigidAsPossible.of(shape_of(mesh)), np.random.default_rng(0)
    positions, direction = mesh.vertices + 0.05 * random.standard_normal((2, mesh.n_vertices, 3))

    def energy(moved):
        return surface.energy(moved, surface.rotations(moved))

    slope = (energy(positions + 1e-5 * direction) - energy(positions - 1e-5 * direction)) / 2e-5
    product = surface.weights.sum(axis=1)[:, None] * positions - surface.weights @ positions
    assert slope == pytest.approx(
        2 * np.vdot(product - surface.load(surface.rotations(positions)), direction)
    )


def test_rotations_are_proper_and_the_best():
    covariances = np.random.default_rng(0).standard_normal((50, 3, 3))
    covariances[1, 2], covariances[2, 1:], covariances[3], covariances[4] = (
        0.0,
        0.0,
        -np.eye(3),
        0.0,
    )
    rotations = nearest_rotations(covariances)
    for unit in (1.0, 1e-3):
        np.testing.assert_array_equal(
            np.flatnonzero(_closed_form(unit * covariances)[1]), [2, 3, 4]
        )  # left to libigl
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12
    )
    left, sizes, right = np.linalg.svd(covariances)
    sizes[:, 2] *= np.linalg.det(left @ right)
    np.testing.assert_allclose(
        np.trace(rotations @ covariances, axis1=1, axis2=2), sizes.sum(axis=1), atol=1e-12
    )


@pytest.mark.parametrize(
    ("method", "fit"), [(ConstrainedMDS(), "deform_towards"), (FeaturePreserved(), "move_onto")]
)
def test_a_rigid_motion_of_the_surface_is_found_even_from_its_mirror_image(method, fit):
    mesh = lopsided(tube(1.3))
    for image in (mesh.vertices, mesh.vertices * [1.0, -1.0, 1.0]):
        targets = image @ Rotation.from_euler("xyz", [2.8, -0.5, 1.9]).as_matrix().T + 9
        form = getattr(method, fit)(shape_of(mesh), targets)
        np.testing.assert_allclose(moved_to(form.vertices, mesh.vertices), mesh.vertices, atol=1e-6)
        assert form.notes["mirrored"] == ("no" if image is mesh.vertices else "yes")
        assert form.notes["largest_edge_strain"] < 1e-6


def spread_of(points, masses):
    return (np.outer(masses, masses) * spread(points)).sum() / 2


def test_repulsion_is_the_gradient_of_the_spread():
    generator = np.random.default_rng(0)
    points, masses = generator.standard_normal((30, 3)), generator.uniform(1, 2, 30)
    direction, step = generator.standard_normal((30, 3)), 1e-5
    slope = (
        spread_of(points + step * direction, masses) - spread_of(points - step * direction, masses)
    ) / (2 * step)
    assert np.vdot(repulsion(points, masses), direction) == pytest.approx(slope)


def test_a_rolled_sheet_becomes_flat_within_the_bound_on_its_strain(bound=0.03):
    mesh = sheet(bend=2.0)
    form = MeshUnfolding(strain_bound=bound).canonicalise(shape_of(mesh))
    extents = np.sqrt(np.linalg.eigvalsh(np.cov(form.vertices.T)))
    assert extents[0] < 0.02 * extents[2]
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    before, after = (
        np.linalg.norm(np.diff(x[edges], axis=1)[:, 0], axis=1)
        for x in (mesh.vertices, form.vertices)
    )
    strains = np.abs(after / before - 1)
    assert strains.mean() <= bound
    assert strains.mean() == pytest.approx(form.notes["mean_edge_strain"])
    assert strains.max() == pytest.approx(form.notes["largest_edge_strain"])

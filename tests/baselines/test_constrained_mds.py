import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import AsRigidAsPossible
from baselines.constrained_mds import ConstrainedMDS
from tests.baselines.deformable import shape_of, sheet, tube

pytestmark = pytest.mark.kernels


def elastic(mesh):
    return AsRigidAsPossible.of(shape_of(mesh))


def test_the_elastic_step_agrees_with_libigl():
    import igl

    mesh = sheet(rows=14, columns=7, bend=0.6)
    surface = elastic(mesh)
    handles = np.flatnonzero((mesh.vertices[:, 0] < 0.1) | (mesh.vertices[:, 0] > mesh.vertices[:, 0].max() - 0.1))
    goals = mesh.vertices[handles].copy()
    raised = goals[:, 0] > 0.5
    goals[raised] += [-0.2, 0.1, 0.4]
    steps = 25

    data = igl.ARAPData()
    data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
    data.max_iter = steps
    igl.arap_precomputation(mesh.vertices, mesh.faces.astype(np.int64), 3, handles.astype(np.int32), data)
    expected = igl.arap_solve(goals, data, mesh.vertices.copy())

    # A pull that outweighs the surface by far holds the handles as a hard constraint does.
    pull = np.zeros(mesh.n_vertices)
    pull[handles] = 1e7
    targets = np.zeros_like(mesh.vertices)
    targets[handles] = goals
    solve = surface.factorise(pull)
    positions = mesh.vertices.copy()
    positions[handles] = goals
    for _ in range(steps):
        positions = solve(surface.load(surface.rotations(positions)) + pull[:, None] * targets)
    np.testing.assert_allclose(positions, expected, atol=1e-5 * np.ptp(mesh.vertices))


def test_rigidly_moved_targets_leave_the_surface_as_it_is():
    mesh = tube(1.3)
    targets = mesh.vertices @ Rotation.from_euler("xyz", [2.8, -0.5, 1.9]).as_matrix().T + [9, 9, 9]
    form = ConstrainedMDS().deform_towards(shape_of(mesh), targets)
    np.testing.assert_allclose(form.vertices, mesh.vertices, atol=1e-9)


def lopsided(mesh):
    """Twist a tube about its own axis, so that no mirror image can be turned into it."""
    x, y, z = mesh.vertices.T
    angle = 2.0 * x
    return mesh.with_vertices(
        np.stack([x, 1.8 * y * np.cos(angle) - z * np.sin(angle), 1.8 * y * np.sin(angle) + z * np.cos(angle)], axis=1)
    )


def test_mirrored_targets_are_detected(axis=1):
    mesh = lopsided(tube(1.3))
    mirrored = mesh.vertices.copy()
    mirrored[:, axis] *= -1
    form = ConstrainedMDS().deform_towards(shape_of(mesh), mirrored)
    assert form.notes["mirrored"] == "yes"
    assert form.notes["energy"] < 1e-12 < 1e-3 < form.notes["rejected_energy"]
    np.testing.assert_allclose(form.vertices, mesh.vertices, atol=1e-8)

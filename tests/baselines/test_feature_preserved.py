import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import AsRigidAsPossible
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.rigid_parts import close_gaps, nearest_seed, refit_parts, smooth_seams
from baselines.feature_preserved import FeaturePreserved
from baselines.least_squares_mds import LeastSquaresMDS
from tests.baselines.deformable import (
    centre_line,
    check_real_body,
    moved_to,
    shape_of,
    straightness,
    tube,
)
from tests.baselines.test_constrained_mds import lopsided


def divided(mesh, count=5):
    """The springs of a mesh, its areas, parts around a few vertices, and motions of them."""
    shape = shape_of(mesh)
    seeds = np.linspace(0, mesh.n_vertices - 1, count).astype(int)
    parts = nearest_seed(shape.geodesics_from(seeds))
    rotations = Rotation.from_rotvec(0.4 * np.random.default_rng(2).standard_normal((count, 3))).as_matrix()
    translations = 0.1 * np.random.default_rng(3).standard_normal((count, 3))
    return AsRigidAsPossible.of(shape), vertex_areas(mesh), parts, rotations, translations


def test_gaps_are_closed_as_a_general_minimiser_closes_them():
    surface, masses, parts, rotations, translations = divided(tube(1.0, rings=12), 4)
    weights = surface.weights.tocoo()
    edges = [e for e in zip(weights.row, weights.col, weights.data, strict=True) if e[0] < e[1]]
    seams = [(i, j, w) for i, j, w in edges if parts[i] != parts[j]]
    shares = np.bincount(parts, masses) / masses.sum()
    p = surface.rest

    def energy(flat):
        t = flat.reshape(-1, 3)
        total = (shares[:, None] * (t - translations) ** 2).sum()
        for i, j, w in seams:
            c, d = parts[i], parts[j]
            gap = rotations[c] @ p[i] + t[c] - rotations[d] @ p[j] - t[d]
            total += w * ((gap - 0.5 * (rotations[c] + rotations[d]) @ (p[i] - p[j])) ** 2).sum()
        return total

    found = close_gaps(surface, masses, parts, rotations, translations)
    expected = minimize(energy, translations.ravel(), tol=1e-14).x.reshape(-1, 3)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert energy(found.ravel()) < 0.5 * energy(translations.ravel())


def test_smoothing_is_the_dense_least_squares_solution():
    surface, masses, parts, rotations, translations = divided(tube(1.0, rings=10), 3)
    placed = np.einsum("nab,nb->na", rotations[parts], surface.rest) + translations[parts]
    n, width = len(placed), 0.2
    weights = surface.weights.tocoo()
    rows, right = [], []
    for i, j, w in zip(weights.row, weights.col, weights.data, strict=True):
        if i < j:
            row = np.zeros(n)
            row[[i, j]] = np.sqrt(w), -np.sqrt(w)
            turn = (rotations[parts[i]] + rotations[parts[j]]) / 2
            rows.append(row)
            right.append(np.sqrt(w) * turn @ (surface.rest[i] - surface.rest[j]))
    pulls = np.sqrt(masses) / width
    system = np.vstack([rows, np.diag(pulls)])
    expected = np.linalg.lstsq(system, np.vstack([right, pulls[:, None] * placed]), rcond=None)[0]
    found = smooth_seams(surface, masses, placed, rotations[parts], width)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_rigid_motion_of_the_surface_is_found_even_from_its_mirror_image():
    mesh = lopsided(tube(1.3))
    for image in (mesh.vertices, mesh.vertices * [1.0, -1.0, 1.0]):
        targets = image @ Rotation.from_euler("xyz", [1.0, 2.0, 3.0]).as_matrix().T
        form = FeaturePreserved().move_onto(shape_of(mesh), targets)
        np.testing.assert_allclose(moved_to(form.vertices, mesh.vertices), mesh.vertices, atol=1e-6)
        assert form.notes["largest_edge_strain"] < 1e-6
        assert form.notes["mirrored"] == ("no" if image is mesh.vertices else "yes")


def test_seams_shift_to_the_joint():
    # A tube with one joint, bent by a right angle at a third of its length; the seed parts meet at its middle.
    mesh = tube(0.0, rings=61)
    along = mesh.vertices[:, 0]
    joint = along < 2 / 3
    targets = mesh.vertices.copy()
    targets[joint] = (mesh.vertices[joint] - [2 / 3, 0, 0]) @ Rotation.from_euler("y", 90, degrees=True).as_matrix().T
    targets[joint] += [2 / 3, 0, 0]
    surface, masses = AsRigidAsPossible.of(shape_of(mesh)), vertex_areas(mesh)
    parts = refit_parts(surface, targets, masses, (along > 1.0).astype(np.int64), 40)
    assert (parts == ~joint).mean() > 0.98


def test_a_bent_tube_straightens_to_the_pose_of_its_scaling():
    mesh = tube(2.4)
    form = FeaturePreserved().canonicalise(shape_of(mesh))
    targets = LeastSquaresMDS().canonicalise(shape_of(mesh)).vertices
    assert straightness(centre_line(mesh.vertices)) < 0.8
    assert straightness(centre_line(form.vertices)) == pytest.approx(straightness(centre_line(targets)), abs=0.03)
    assert form.notes["mean_edge_strain"] < 0.08


@pytest.mark.data
@pytest.mark.parametrize("name", ["michael6"])
def test_real_bodies_spread_their_limbs(data_root, name):
    form = check_real_body(FeaturePreserved(), data_root / "tosca" / f"{name}.off")
    assert form.notes["mean_edge_strain"] <= 0.08

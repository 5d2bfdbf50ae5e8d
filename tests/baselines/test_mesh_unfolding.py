import numpy as np
import pytest
from scipy.spatial.distance import cdist

from baselines._kernels.arap import AsRigidAsPossible
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.repulsion import relax, repulsion
from baselines.mesh_unfolding import MeshUnfolding
from tests.baselines.deformable import (
    centre_line,
    check_real_body,
    moved_to,
    shape_of,
    sheet,
    straightness,
    tube,
)

pytestmark = pytest.mark.kernels


def test_repulsion_agrees_with_all_pairwise_distances():
    random = np.random.default_rng(0)
    points, masses = random.normal(size=(40, 3)), random.uniform(0.1, 1, size=40)
    forces, spread = repulsion(points, masses)
    distances = cdist(points, points)
    assert spread == pytest.approx(masses @ distances @ masses / 2)
    np.fill_diagonal(distances, 1)
    ratios = np.outer(masses, masses) / distances
    np.testing.assert_allclose(forces, ratios.sum(axis=1)[:, None] * points - ratios @ points, atol=1e-12)
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize("mesh", [tube(2.4), sheet(bend=2.0)], ids=["tube", "sheet"])
@pytest.mark.parametrize("stiffness", [1.0])
def test_the_energy_never_rises_and_the_centroid_stays(mesh, stiffness):
    shape = shape_of(mesh.with_vertices(mesh.vertices / np.sqrt(mesh.area)))
    areas = vertex_areas(shape.mesh)
    surface = AsRigidAsPossible.of(shape)
    positions, energies = relax(surface, areas / areas.sum(), surface.rest, stiffness, 40)
    assert np.diff(energies).max() <= 1e-12
    assert energies[-1] < energies[0] - 1e-3
    np.testing.assert_allclose(areas @ positions, areas @ surface.rest, atol=1e-9)
    _, spread = repulsion(positions, areas / areas.sum())
    expected = stiffness * surface.energy(positions, surface.rotations(positions)) - spread
    assert energies[-1] == pytest.approx(expected)


@pytest.mark.parametrize(("bend", "expected"), [(2.4, 0.98)])
def test_a_bent_tube_becomes_straight(bend, expected):
    mesh = tube(bend)
    form = MeshUnfolding().canonicalise(shape_of(mesh))
    # The tube is thick: straightened fully from the largest bend, its sides would exceed the strain bound.
    assert straightness(centre_line(form.vertices)) > expected > straightness(centre_line(mesh.vertices))
    straight = tube(0.0).vertices
    before, after = (
        np.linalg.norm(moved_to(vertices, straight) - straight, axis=1).mean()
        for vertices in (mesh.vertices, form.vertices)
    )
    assert after < 0.6 * before


def test_a_flat_sheet_stays_flat_and_a_rolled_one_becomes_flat():
    flat = MeshUnfolding().canonicalise(shape_of(sheet()))
    np.testing.assert_allclose(flat.vertices[:, 2], 0, atol=1e-9)
    rolled = MeshUnfolding().canonicalise(shape_of(sheet(bend=2.0)))
    extents = np.sqrt(np.linalg.eigvalsh(np.cov(rolled.vertices.T)))
    assert extents[0] < 0.02 * extents[2]


def test_the_strain_bound_holds_and_is_recorded(bound=0.03):
    shape = shape_of(tube(2.4))
    form = MeshUnfolding(strain_bound=bound).canonicalise(shape)
    strains = AsRigidAsPossible.of(shape).edge_strains(form.vertices)
    assert 0 < strains.mean() <= bound
    assert form.notes["mean_edge_strain"] == pytest.approx(strains.mean())
    assert form.notes["largest_edge_strain"] == pytest.approx(strains.max())


@pytest.mark.data
@pytest.mark.parametrize("name", ["michael6"])
def test_real_bodies_spread_their_limbs(data_root, name):
    form = check_real_body(MeshUnfolding(), data_root / "tosca" / f"{name}.off")
    assert form.notes["mean_edge_strain"] <= 0.05

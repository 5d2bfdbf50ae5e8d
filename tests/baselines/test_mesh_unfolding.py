import numpy as np
import pytest

from baselines._kernels.arap import AsRigidAsPossible
from baselines.mesh_unfolding import MeshUnfolding
from tests.baselines.deformable import centre_line, moved_to, shape_of, sheet, straightness, tube

pytestmark = pytest.mark.kernels


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

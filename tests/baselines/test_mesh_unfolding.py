import numpy as np
import pytest

from baselines._kernels.arap import AsRigidAsPossible
from baselines.mesh_unfolding import MeshUnfolding
from tests.baselines.deformable import shape_of, sheet, tube

pytestmark = pytest.mark.kernels


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

import numpy as np
import pytest

from baselines._kernels.springs import Springs
from baselines.euclidean_distance import EuclideanDistance
from tests.baselines.deformable import centre_line, shape_of, straightness, tube
from tests.baselines.embedding import sphere


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

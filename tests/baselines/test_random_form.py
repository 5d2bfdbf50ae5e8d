import numpy as np

from baselines.random_form import RandomForm
from tests.baselines.embedding import limbed


def test_only_size_and_place_of_the_shape_survive():
    shape = limbed(2000)
    positions = RandomForm().canonicalise(shape).vertices
    centred = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    assert np.linalg.norm(positions.mean(axis=0) - shape.mesh.vertices.mean(axis=0)) < 0.1 * centred.std()
    np.testing.assert_allclose(positions.var(axis=0), (centred**2).sum() / 3 / len(centred), rtol=0.1)
    assert np.abs(np.corrcoef(positions.T, centred.T)[:3, 3:]).max() < 0.1

import numpy as np

from baselines.random_form import RandomForm
from benchmark.api.contracts import Shape
from tests.baselines.embedding import limbed


def test_only_size_and_place_of_the_shape_survive():
    shape = limbed(2000)
    positions = RandomForm().canonicalise(shape).vertices
    centred = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    assert np.linalg.norm(positions.mean(axis=0) - shape.mesh.vertices.mean(axis=0)) < 0.1 * centred.std()
    np.testing.assert_allclose(positions.var(axis=0), (centred**2).sum() / 3 / len(centred), rtol=0.1)
    assert np.abs(np.corrcoef(positions.T, centred.T)[:3, 3:]).max() < 0.1


def test_the_form_depends_on_seed_and_name_and_not_on_the_order_of_calls():
    mesh = limbed(100).mesh
    first = RandomForm().canonicalise(Shape(identifier="a", mesh=mesh, seed=1)).vertices
    RandomForm().canonicalise(Shape(identifier="b", mesh=mesh, seed=1))
    np.testing.assert_array_equal(first, RandomForm().canonicalise(Shape(identifier="a", mesh=mesh, seed=1)).vertices)
    for identifier, seed in (("a", 2), ("b", 1)):
        assert (first != RandomForm().canonicalise(Shape(identifier=identifier, mesh=mesh, seed=seed)).vertices).any()

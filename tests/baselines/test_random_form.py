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


def test_the_form_depends_on_seed_and_shape_and_neither_on_names_nor_on_the_order_of_calls():
    mesh = limbed(100).mesh

    def form(identifier, mesh, seed):
        return RandomForm().canonicalise(Shape(identifier=identifier, mesh=mesh, seed=seed)).vertices

    first = form("a", mesh, 1)
    stretched = mesh.with_vertices(mesh.vertices * [1, 1, 1.01])
    assert (first != form("a", mesh, 2)).any()
    assert (first != form("a", stretched, 1)).any()
    np.testing.assert_array_equal(first, form("b", mesh, 1))

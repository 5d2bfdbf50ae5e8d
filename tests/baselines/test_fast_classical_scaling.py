import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.sampling import farthest_points
from baselines.classic_mds import ClassicMDS
from baselines.fast_classical_scaling import FastClassicalScaling
from benchmark.api.contracts import Shape
from benchmark.datasets.official.tosca import tosca
from benchmark.geometry.preparation import prepare
from tests.baselines.embedding import limbed, spread


def released(shape: Shape, samples: int, fidelity: float) -> np.ndarray:
    """Distances of the form by the steps of the released code, with dense matrices of all vertices."""
    laplacian = shape.laplacian()
    n, stiffness = len(laplacian.mass), laplacian.stiffness.toarray()
    areas = laplacian.mass * n / laplacian.mass.sum()
    chosen = farthest_points(shape, samples)
    fit = np.zeros((n, n))
    fit[chosen, chosen] = fidelity
    continuation = np.linalg.solve(stiffness.T @ np.diag(areas**-2.0) @ stiffness + fit, fit[:, chosen])
    product = continuation @ shape.geodesics()[chosen] ** 2
    centre = np.eye(n) - 1 / n
    values, vectors = eigh(-0.25 * centre @ (product + product.T) @ centre, subset_by_index=(n - 3, n - 1))
    return spread(vectors * np.sqrt(np.maximum(values, 0)))


def require_released(shape: Shape, samples: int, fidelity: float) -> None:
    expected = released(shape, samples, fidelity)
    form = FastClassicalScaling(samples=samples, fidelity=fidelity).canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=1e-6 * expected.max())


@pytest.mark.parametrize(("samples", "fidelity"), [(20, 50.0), (30, 1e8), (12, 0.1)])
def test_the_form_is_that_of_the_released_code(samples, fidelity):
    require_released(limbed(250), samples, fidelity)


@pytest.mark.data
def test_forms_of_animals_and_people_are_those_of_the_released_code(data_root):
    dataset = tosca(data_root)
    for entry in dataset.entries[::8]:
        mesh = prepare(dataset.load(entry)).mesh
        require_released(Shape(identifier=entry.identifier, mesh=mesh), 20, 50.0)


def test_all_samples_and_an_exact_fit_give_classic_scaling():
    shape = limbed(120)
    form = FastClassicalScaling(samples=120, fidelity=1e12).canonicalise(shape)
    np.testing.assert_allclose(form.vertices, ClassicMDS().canonicalise(shape).vertices, atol=1e-4)

import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.sampling import farthest_points
from baselines.classic_mds import ClassicMDS
from baselines.spectral_mds import SpectralMDS
from benchmark.api.contracts import Shape
from tests.baselines.embedding import brute_force_stress, limbed, spread


class RowsOnly(Shape):
    """A shape that has no all pairs of distances to give."""

    def geodesics(self, solver: str = "default") -> np.ndarray:
        raise AssertionError("all pairs were asked for")


def published(shape: Shape, samples: int, eigenfunctions: int, fidelity: float) -> np.ndarray:
    """Distances of the form by the formulas with dense matrices, fitted by stacked least squares."""
    laplacian = shape.laplacian()
    area = laplacian.mass.sum()
    values, functions = eigh(area * laplacian.stiffness.toarray(), np.diag(laplacian.mass))
    values, functions = np.maximum(values, 0)[: eigenfunctions + 1], functions[:, : eigenfunctions + 1] * np.sqrt(area)
    chosen = farthest_points(shape, samples)
    stacked = np.vstack([functions[chosen], np.diag(values) * np.sqrt(len(chosen) / fidelity)])
    fit = np.linalg.lstsq(stacked, np.vstack([np.eye(len(chosen)), np.zeros((len(values), len(chosen)))]), rcond=None)
    continuation = functions @ fit[0]
    squared = continuation @ shape.geodesics()[np.ix_(chosen, chosen)] ** 2 @ continuation.T
    centre = np.eye(len(squared)) - 1 / len(squared)
    found, vectors = np.linalg.eigh(-0.5 * centre @ (squared + squared.T) / 2 @ centre)
    return spread(vectors[:, -3:] * np.sqrt(np.maximum(found[-3:], 0)))


@pytest.mark.parametrize(("samples", "eigenfunctions", "fidelity"), [(30, 60, 1e8), (20, 20, 1e3)])
def test_the_form_is_that_of_the_published_formula(samples, eigenfunctions, fidelity):
    shape = limbed(250)
    method = SpectralMDS(samples=samples, eigenfunctions=eigenfunctions, fidelity=fidelity)
    form = method.canonicalise(shape)
    expected = published(shape, samples, eigenfunctions, fidelity)
    np.testing.assert_allclose(spread(form.vertices), expected, atol=2e-4 * expected.max())
    assert (form.notes["samples"], form.notes["eigenfunctions"]) == (samples, eigenfunctions)


def test_all_samples_and_all_eigenfunctions_give_classic_scaling():
    shape = limbed(120)
    form = SpectralMDS(samples=120, eigenfunctions=119, fidelity=1e16).canonicalise(shape)
    np.testing.assert_allclose(form.vertices, ClassicMDS().canonicalise(shape).vertices, atol=1e-4)


def test_the_stress_is_near_that_of_classic_scaling_without_all_pairs():
    shape = limbed(1000)
    classic = ClassicMDS().canonicalise(shape).notes["stress"]
    form = SpectralMDS().canonicalise(RowsOnly(identifier="limbed", mesh=shape.mesh))
    assert brute_force_stress(form.vertices, shape.geodesics()) < 1.2 * classic

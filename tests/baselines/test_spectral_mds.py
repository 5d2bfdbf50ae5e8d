import numpy as np
import pytest
from scipy.linalg import eigh

from baselines._kernels.sampling import farthest_points
from baselines.accelerated_mds import AcceleratedMDS
from baselines.classic_mds import ClassicMDS, classic_scaling
from baselines.spectral_mds import SpectralMDS
from benchmark.api.contracts import Shape
from tests.baselines.deformable import shape_of, sheet
from tests.baselines.embedding import assert_contract, brute_force_stress, limbed, sphere, spread


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


@pytest.mark.parametrize(("samples", "eigenfunctions", "fidelity"), [(30, 60, 1e8), (60, 40, 1e5), (20, 20, 1e3)])
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


def test_all_eigenfunctions_and_an_exact_fit_give_the_interpolation_of_accelerated_mds():
    shape = limbed(150)
    form = SpectralMDS(samples=40, eigenfunctions=149, fidelity=1e16).canonicalise(shape)
    other = AcceleratedMDS(variant="samples", samples=40).canonicalise(shape)
    np.testing.assert_allclose(form.vertices, other.vertices, atol=1e-4)


def test_the_stress_is_near_that_of_classic_scaling_without_all_pairs():
    shape = limbed(1000)
    classic = ClassicMDS().canonicalise(shape).notes["stress"]
    form = SpectralMDS().canonicalise(RowsOnly(identifier="limbed", mesh=shape.mesh))
    assert brute_force_stress(form.vertices, shape.geodesics()) < 1.2 * classic


def test_bending_does_not_change_the_form():
    # The functions are level across a border and squared distances are not, so that an open surface is the hard case,
    # and which vertices are samples matters more than for other methods.
    flat, rolled = (SpectralMDS().canonicalise(shape_of(sheet(bend=bend))).vertices for bend in (0.0, 2.0))
    assert np.abs(spread(rolled) - spread(flat)).max() < 0.08 * spread(flat).max()


def test_fifty_vertices_are_enough():
    shape = shape_of(sphere(50))
    form = SpectralMDS().canonicalise(shape)
    classic, _ = classic_scaling(shape.geodesics())
    assert np.isfinite(form.vertices).all()
    # All vertices are samples, and 49 functions with a constant fit any values at them.
    np.testing.assert_allclose(spread(form.vertices), spread(classic), atol=0.05)


def test_contract():
    assert_contract(SpectralMDS(), limbed(300), atol=1e-5)

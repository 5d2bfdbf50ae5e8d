import numpy as np

from baselines.wks_mean import MeanWKS
from benchmark.api.contracts import Shape
from benchmark.geometry.laplacian import eigenpairs
from tests.baselines.embedding import limbed, sphere


def test_on_a_sphere_no_place_is_special():
    # All functions of degrees 1 to 3: the squares of each degree sum to a constant, so every band is even.
    found = MeanWKS(eigenpairs=15).describe(Shape(identifier="sphere", mesh=sphere(1500)))
    np.testing.assert_allclose(found, 1, atol=0.01)


def test_the_descriptor_agrees_with_the_definition():
    shape = limbed(200)
    laplacian = shape.laplacian()
    values, functions = eigenpairs(laplacian, 21)
    area = laplacian.mass.sum()
    logs = np.log(area * values[1:])
    energies = np.linspace(logs[0], logs[-1] / 1.02, 10)
    expected = []
    for energy in energies:
        weights = np.exp(-((energy - logs) ** 2) / (2 * (7 * (energies[1] - energies[0])) ** 2))
        signature = sum(w * functions[:, k + 1] ** 2 for k, w in enumerate(weights)) / weights.sum()
        expected.append(area * np.sqrt((laplacian.mass * signature**2).sum() / area))
    np.testing.assert_allclose(MeanWKS(eigenpairs=20, energies=10).describe(shape), expected, rtol=1e-10)

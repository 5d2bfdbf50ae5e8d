"""Descriptors on shapes whose values follow by hand, or from another decomposition."""

import tracemalloc

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from baselines.sd_gdm import SDGDM
from baselines.shape_dna import ShapeDNA
from baselines.si_hks import ScaleInvariantHKS
from baselines.surface_area import SurfaceArea
from benchmark.api.contracts import Descriptor, Shape, UnsupportedShape
from benchmark.geometry.laplacian import eigenpairs
from benchmark.pipeline.outputs import compute_distances
from tests.baselines.embedding import PointShape, limbed, points_on_ellipsoid, sphere


def ball(n, radius=1.0, area=None):
    return Shape(
        identifier="ball",
        mesh=sphere(n).with_vertices(radius * sphere(n).vertices),
        source_area=area,
    )


@pytest.mark.parametrize(
    ("method", "descriptors", "distances"),
    [
        (SDGDM(), [[0.6, 0.4], [0.2, 0.8]], [[0, 1 + 2 / 3], [1 + 2 / 3, 0]]),
        (ShapeDNA(), [[0.0, 3], [4.0, 0], [0.0, 3]], [[0, 5, 0], [5, 0, 5], [0, 5, 0]]),
        (SurfaceArea(), [[2.0], [5.0], [4.5]], [[0, 3, 2.5], [3, 0, 0.5], [2.5, 0.5, 0]]),
    ],
)
def test_distances_by_hand(method, descriptors, distances):
    np.testing.assert_allclose(method.distances([np.array(row) for row in descriptors]), distances)
    assert isinstance(method, Descriptor)


def test_sd_gdm_has_the_spectrum_of_the_distances():
    # The matrix of ones without its diagonal: n - 1 once and -1 otherwise.
    equal = PointShape(points_on_ellipsoid(60), np.ones((60, 60)) - np.eye(60))
    np.testing.assert_allclose(
        SDGDM(count=5).describe(equal), np.array([59, 1, 1, 1, 1]) / 63, atol=1e-10
    )
    shape = limbed()
    expected = np.linalg.svd(shape.geodesics(), compute_uv=False)[:20]
    np.testing.assert_allclose(SDGDM().describe(shape), expected / expected.sum(), atol=1e-9)


@pytest.mark.parametrize("radius", [1, 5])
def test_shape_dna_has_the_spectrum_of_a_sphere(radius):
    # Eigenvalues l (l + 1), each 2 l + 1 times, times the area 4 pi, whatever the radius.
    expected = 4 * np.pi * np.array([2] * 3 + [6] * 5 + [12] * 4)
    np.testing.assert_allclose(ShapeDNA().describe(ball(2000, radius)), expected, rtol=0.02)


def test_surface_area_is_that_before_scaling():
    assert SurfaceArea().describe(ball(50, area=4.5)) == 4.5
    with pytest.raises(UnsupportedShape, match="area before scaling"):
        SurfaceArea().describe(ball(50))


def test_si_hks_is_the_spectrum_of_the_slope_of_the_logarithm():
    shape = limbed(200)
    laplacian = shape.laplacian()
    area = laplacian.mass.sum()
    values, functions = eigenpairs(laplacian, 41)

    def log_signature(tau):
        return np.log(functions**2 * area @ np.exp(-values[:, None] * area * 2**tau))

    tau, step = np.linspace(-19, 5, 24 * 16 + 1), 1e-4
    slope = (log_signature(tau + step) - log_signature(tau - step)) / (2 * step)
    waves = np.exp(-2j * np.pi * np.outer(np.arange(len(tau)), np.arange(4)) / len(tau))
    rows = ScaleInvariantHKS(eigenpairs=40, frequencies=4).describe(shape).reshape(-1, 5)
    moduli = abs(slope @ waves)
    np.testing.assert_allclose(rows[:, 1:], moduli[np.argsort(moduli[:, 0])], rtol=1e-5, atol=1e-5)


def test_si_hks_counts_the_words_of_a_gallery():
    # Words at 1 and 5, so that each vertex is 1 from its nearest one, and sigma is 2.
    method = ScaleInvariantHKS(frequencies=1, words=2)
    gallery = [np.ravel(rows) for rows in ([[1.0, 0]], [[0.5, 2], [0.5, 6]], [[0.3, 4], [0.7, 6]])]
    zero, two, four, six = (
        1 / (1 + np.exp(((x - 1) ** 2 - (x - 5) ** 2) / 8)) for x in (0, 2, 4, 6)
    )
    first = np.array([zero, (two + six) / 2, 0.3 * four + 0.7 * six])
    np.testing.assert_allclose(
        method.distances(gallery), 2 * np.abs(first[:, None] - first), atol=1e-12
    )
    # No vertex but the words: each belongs to its own alone.
    two_places = [
        np.ravel(rows) for rows in ([[1.0, 0]], [[0.5, 0], [0.5, 6]], [[0.3, 6], [0.7, 6]])
    ]
    np.testing.assert_allclose(
        method.distances(two_places), [[0, 1, 2], [1, 0, 1], [2, 1, 0]], atol=1e-12
    )
    np.testing.assert_array_equal(method.distances([np.array([1.0, 3.0])] * 2), 0)


def test_si_hks_takes_the_words_of_the_gallery_alone_for_any_queries():
    method, places = (
        ScaleInvariantHKS(frequencies=1, words=2),
        np.random.default_rng(0).random((5, 1, 6, 1)) * 9,
    )
    of = [np.concatenate([np.full((6, 1), 1 / 6), one[0]], axis=1).ravel() for one in places]
    together = method.compare_to(of, of[:3])
    np.testing.assert_array_equal(together[:3], method.distances(of[:3]))
    np.testing.assert_array_equal(
        together[3:], [method.compare_to([one], of[:3])[0] for one in of[3:]]
    )
    (row,) = compute_distances(method, of[:3], queries=of[3:4])
    np.testing.assert_array_equal(row, together[3])
    assert not np.allclose(method.distances(of[:4])[3, :3], row)


def test_each_query_of_another_gallery_frees_its_matrix():
    spectra = [np.array([value]) for value in np.linspace(1, 2, 300)]
    tracemalloc.start()
    try:
        found = compute_distances(ShapeDNA(), spectra, queries=spectra[:40])
        assert tracemalloc.get_traced_memory()[1] < 10 * 8 * 301**2
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(found, ShapeDNA().distances(spectra)[:40])


def test_descriptors_are_equal_whatever_the_last_digits_of_a_processor(monkeypatch):
    shape, methods = limbed(200), (ShapeDNA(), ScaleInvariantHKS(eigenpairs=40), SDGDM())
    first = [method.describe(shape) for method in methods]

    def other_digits(*given, **more):
        found = eigsh(*given, **more)
        return (
            tuple(of * (1 + 1e-12) for of in found)
            if isinstance(found, tuple)
            else found * (1 + 1e-12)
        )

    monkeypatch.setattr("scipy.sparse.linalg.eigsh", other_digits)
    for method, expected in zip(methods, first, strict=True):
        np.testing.assert_array_equal(method.describe(limbed(200)), expected)


def test_areas_that_differ_by_rounding_are_equal_and_no_others():
    areas = [np.array([1.8]), np.array([np.nextafter(1.8, 2)]), np.array([1.8 * (1 + 1e-6)])]
    distances = SurfaceArea().distances(areas)
    assert distances[0, 1] == 0
    assert distances[0, 2] == pytest.approx(1.8e-6)

"""What Spherical Harmonics promises."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y
from spherical_harmonics import SphericalHarmonics, energies

from benchmark.check import failures
from benchmark.check.shapes import figure


def test_it_keeps_the_contract() -> None:
    assert not failures(SphericalHarmonics)


def test_forms_that_differ_by_rotation_and_reflection_tie() -> None:
    scorer, form = SphericalHarmonics(), figure()
    turns = [
        np.eye(3),
        np.diag([-1.0, 1.0, 1.0]),
        *Rotation.random(3, rng=np.random.default_rng(0)).as_matrix(),
    ]
    signatures = [scorer.signature(form.with_vertices(form.vertices @ turn)) for turn in turns]
    assert not scorer.compare(signatures, 0).any()


def test_energies_are_those_of_the_harmonics_of_scipy() -> None:
    random = np.random.default_rng(1)
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    weights = random.uniform(size=(3, 40))
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    expected = np.zeros((3, 16))
    for degree in range(16):
        for order in range(-degree, degree + 1):
            expected[:, degree] += np.abs(weights @ sph_harm_y(degree, order, polar, azimuth)) ** 2
    np.testing.assert_allclose(
        energies(directions, csr_array(weights), 16), np.sqrt(expected), atol=1e-12
    )

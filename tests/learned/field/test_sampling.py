"""Points that stand for a surface lie evenly, on it, and where its geometry says."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.geometry.mesh import Mesh
from learned.field.sampling import even_samples, random_samples
from learned.frame import frame_of
from tests.geometry.surfaces import flat_grid, limbed_body, relabelled, sphere


def framed(mesh: Mesh) -> Mesh:
    return frame_of(mesh).seen(mesh)


BODY = framed(limbed_body())


@pytest.mark.parametrize("mesh", [BODY, sphere(2), framed(flat_grid(6))], ids=["body", "sphere", "grid"])
@pytest.mark.kernels
def test_numbering_leaves_no_trace(mesh):
    """Not even where all distances tie, as on a grid."""
    one, other = even_samples(mesh, 100), even_samples(relabelled(mesh, 1)[0], 100)
    assert np.abs(one.points - other.points).max() < 1e-9
    assert np.abs(one.normals - other.normals).max() < 1e-6


def test_random_samples_are_uniform_by_area():
    """A large and a small triangle, 9 to 1."""
    mesh = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0], [9, 9, 9], [10, 9, 9], [9, 10, 9]], [[0, 1, 2], [3, 4, 5]])
    samples = random_samples(mesh, 4000, np.random.default_rng(0))
    assert (samples.points[:, 2] == 0).mean() == pytest.approx(0.9, abs=0.05)
    assert np.array_equal(samples.points, random_samples(mesh, 4000, np.random.default_rng(0)).points)

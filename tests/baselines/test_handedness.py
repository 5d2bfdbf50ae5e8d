"""Handedness: by hand, of mirror images, turned and jittered surfaces, other triangulations and open views."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines._kernels.orientation import handedness, vertex_areas
from benchmark.api.contracts import Shape
from benchmark.check.shapes import figure
from benchmark.registry import select_one

MIRROR = np.array([1.0, 1.0, -1.0])
TURNED = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()

OPEN = ("classic-mds", "fast-mds", "fast-classical-scaling", "accelerated-mds", "gps")


def alignment(points, others, weights):
    """Distance of points from others, turned onto them, over the radius of gyration; whether a mirror is nearer."""
    points, others = points - weights @ points, others - weights @ others
    left, _, right = np.linalg.svd((points * weights[:, None]).T @ others)
    mirrored = np.linalg.det(left @ right) < 0
    if mirrored:
        left[:, 2] *= -1
    rest = weights @ ((points @ left @ right - others) ** 2).sum(axis=1)
    return np.sqrt(rest / (weights @ (others**2).sum(axis=1))), mirrored


def shape(mesh):
    return Shape(identifier="figure", mesh=mesh)


@pytest.mark.parametrize("name", OPEN)
def test_methods_that_see_distances_alone_settle_the_side(name):
    method = select_one(name).create()
    mesh = figure()
    form = method.canonicalise(shape(mesh))
    weights = vertex_areas(mesh)
    assert handedness(form.vertices, weights) > 0.02
    assert form.notes["handedness"] == pytest.approx(handedness(form.vertices, weights), abs=1e-3)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    for vertices in (mesh.vertices * MIRROR, (mesh.vertices + noise) @ TURNED.T):
        other = method.canonicalise(shape(mesh.with_vertices(vertices)))
        distance, mirrored = alignment(form.vertices, other.vertices, weights / weights.sum())
        assert not mirrored
        assert distance < 0.01

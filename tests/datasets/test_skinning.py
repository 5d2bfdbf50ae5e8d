"""The kernel that poses bodies, by hand and against the dense one of the package that brings the bodies."""

from __future__ import annotations

import numpy as np

from benchmark.datasets import humans
from benchmark.datasets.skinning import linear_blend_skinning


def test_a_vertex_goes_where_its_bones_take_it_on_average() -> None:
    vertices = np.array([[[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]])
    stay, turn = np.eye(4), np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = [0, 0, 10]
    bones = np.array([[0, 1], [1, 0], [0, 1]])
    weights = np.array([[1.0, 0.0], [1.0, 0.0], [0.75, 0.25]])
    posed = linear_blend_skinning(vertices, bones, weights, np.stack([stay, turn])[None])
    np.testing.assert_allclose(posed, [[[1, 0, 0], [-2, 0, 10], [0, 0, 0.75 * 3 + 0.25 * 13]]])


def test_bodies_are_those_of_the_dense_kernel() -> None:
    from anny.skinning.skinning import dense_linear_blend_skinning
    from torch import from_numpy

    model = humans._body().model
    random = np.random.default_rng(0)
    vertices = random.normal(size=(2, len(model.template_vertices), 3))
    transforms = np.tile(np.eye(4), (2, model.bone_count, 1, 1))
    transforms[:, :, :3] = random.normal(size=(2, model.bone_count, 3, 4))
    found = model.get_skinned_vertices(from_numpy(vertices), from_numpy(transforms))
    expected = dense_linear_blend_skinning(
        from_numpy(vertices), model.dense_vertex_bone_weights, from_numpy(transforms)
    )
    np.testing.assert_allclose(found.numpy(), expected.numpy(), rtol=0, atol=1e-12)

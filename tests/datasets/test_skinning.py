"""The kernel that poses bodies, by hand and against the dense one of the package that brings the bodies."""

from __future__ import annotations

import numpy as np

from benchmark.datasets import bodies


def test_bodies_are_those_of_the_dense_kernel() -> None:
    from anny.skinning.skinning import dense_linear_blend_skinning
    from torch import from_numpy

    model = bodies._template().model
    random = np.random.default_rng(0)
    vertices = random.normal(size=(2, len(model.template_vertices), 3))
    transforms = np.tile(np.eye(4), (2, model.bone_count, 1, 1))
    transforms[:, :, :3] = random.normal(size=(2, model.bone_count, 3, 4))
    skinned = model.get_skinned_vertices(from_numpy(vertices), from_numpy(transforms))
    expected = dense_linear_blend_skinning(
        from_numpy(vertices), model.dense_vertex_bone_weights, from_numpy(transforms)
    )
    np.testing.assert_allclose(skinned.numpy(), expected.numpy(), rtol=0, atol=1e-12)

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from retrieval.pose import normalise, rectilinearity_rotation
from tests.retrieval.figures import figure, turned

pytestmark = pytest.mark.kernels


def test_the_rotation_is_the_minimiser(seed: int = 1) -> None:
    mesh = turned(figure(seed), Rotation.random(rng=seed).as_matrix())
    rotation = rectilinearity_rotation(mesh)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)
    corners = mesh.vertices[mesh.faces]
    area_vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    reached = np.abs(
        area_vectors @ rotation.T
    ).sum()  # the areas of projections on the coordinate planes
    rng = np.random.default_rng(seed)
    references = [
        minimize(
            lambda angles: np.abs(
                area_vectors @ Rotation.from_euler("xyz", angles).as_matrix().T
            ).sum(),
            rng.uniform(-np.pi, np.pi, 3),
            method="Nelder-Mead",
        ).fun
        for _ in range(30)
    ]
    assert reached <= min(references) * (1 + 1e-6)


@pytest.mark.parametrize(
    ("seed", "smaller"), [(0, "pca"), (3, "rectilinearity")]
)  # by 2 and 4 per cent
def test_the_pose_with_the_smaller_silhouettes_wins_in_either_order(
    seed: int, smaller: str
) -> None:
    expected = normalise(figure(seed), [smaller], 64).vertices
    for candidates in (["pca", "rectilinearity"], ["rectilinearity", "pca"]):
        np.testing.assert_array_equal(normalise(figure(seed), candidates, 64).vertices, expected)

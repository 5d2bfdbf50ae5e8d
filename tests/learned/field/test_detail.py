"""Predictions say where parts lie, the input what they look like."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmark.geometry.laplacian import cotangent_laplacian
from learned.field.detail import Rest, with_detail
from tests.geometry.surfaces import limbed_body
from tests.learned.toy import misfit

BODY = limbed_body(3)
BODY = BODY.with_vertices(BODY.vertices / BODY.area**0.5)
REST = Rest.of(BODY.vertices, cotangent_laplacian(BODY))
TURN = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix()


@pytest.mark.parametrize("rounds", [0, 3])
def test_a_rigid_motion_is_followed_exactly(rounds):
    target = BODY.vertices @ TURN.T + [1, 2, 3]
    found = with_detail(REST, target, np.broadcast_to(TURN, (BODY.n_vertices, 3, 3)), 0.3, rounds)
    assert np.abs(found - target).max() < 1e-9


def test_wrong_rotations_are_repaired_by_rounds():
    target = BODY.vertices @ TURN.T
    none = np.broadcast_to(np.eye(3), (BODY.n_vertices, 3, 3))
    misfits = [misfit(with_detail(REST, target, none, 0.3, rounds), target) for rounds in (0, 3, 20)]
    assert misfits[0] > misfits[1] > misfits[2]
    assert misfits[2] < 0.5 * misfits[0]

"""What the shipped field makes of people that it has never seen."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.api.contracts import Shape
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import SUBJECTS
from benchmark.datasets.humans import human_mesh
from benchmark.geometry.mesh import Mesh
from learned.field.methods import DeformationField
from tests.learned.toy import misfit


def form_of(mesh: Mesh) -> Mesh:
    return DeformationField().canonicalise(Shape(identifier="x", mesh=mesh)).mesh


def unit(mesh: Mesh) -> np.ndarray:
    return mesh.vertices / mesh.area**0.5


@pytest.mark.slow
@pytest.mark.parametrize(("subject", "pose"), [("woman-3", "kicking"), ("child-2", "throwing")])
def test_an_unseen_person_stands_again(subject: str, pose: str) -> None:
    posed, standing = (human_mesh(SUBJECTS[subject], POSES[name]) for name in (pose, "standing"))
    form = form_of(posed)
    before, after = (misfit(each, unit(standing)) for each in (unit(posed), form.vertices))
    assert after < 0.35 * before
    upside_down = posed.with_vertices(posed.vertices @ np.diag([1, -1, -1]) * 30 + 7)
    assert np.abs(form_of(upside_down).vertices - form.vertices).max() < 1e-3

"""Surfaces with repeated eigenvalues, borders, handles, pieces: a finite form in space, or a refusal that says why."""

from __future__ import annotations

import numpy as np
import pytest
from trimesh.creation import torus

from benchmark.api.contracts import Mesh, Shape
from benchmark.registry import select_one
from tests.baselines.deformable import sheet
from tests.baselines.embedding import sphere

FORMS = ("fast-classical-scaling", "feature-preserved")


def ring() -> Mesh:
    """Closed, with a handle, and round: every eigenvalue but the lowest is double."""
    made = torus(1.0, 0.3, major_sections=24, minor_sections=10)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


CONNECTED = {
    "ball": lambda: sphere(300),
    "ring": ring,
    "rolled sheet": lambda: sheet(rows=18, columns=9, bend=3.0),
    "fifty vertices": lambda: sphere(50),
}


@pytest.mark.parametrize("surface", CONNECTED)
@pytest.mark.parametrize("name", FORMS)
def test_connected_surfaces_have_a_form(name, surface):
    mesh = CONNECTED[surface]()
    form = select_one(name).create().canonicalise(Shape(identifier=surface, mesh=mesh))
    assert form.vertices.shape == mesh.vertices.shape
    assert np.isfinite(form.vertices).all()
    assert np.ptp(form.vertices, axis=0).max() > 0

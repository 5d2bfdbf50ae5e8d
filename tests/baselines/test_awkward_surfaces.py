"""Surfaces with repeated eigenvalues, borders, handles, pieces: a finite form in space, or a refusal that says why."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from trimesh.creation import torus

from benchmark.api.contracts import Mesh, Shape
from benchmark.plugins.registry import methods, variant
from tests.baselines.deformable import sheet
from tests.baselines.embedding import sphere

METRICS = ("diffusion", "commute-time", "biharmonic")
FORMS = (
    "fast-classical-scaling",
    "nystrom-mds",
    "scikit-learn-classical-mds",
    "scikit-learn-smacof",
    "scikit-learn-isomap",
    "subspace-mds",
    "feature-preserved",
    "euclidean-distance",
    "euclidean-distance[points=local]",
    *(f"{name}[metric={metric}]" for name in ("classic-mds", "least-squares-mds") for metric in METRICS),
)


def cube(steps: int = 6) -> Mesh:
    """Surface of a cube with all its symmetries but for the diagonals: eigenvalues come in twos and threes."""
    axis = np.linspace(-1, 1, steps)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    points = points[np.abs(points).max(axis=1) == 1]
    # Blown up to a ball, all vertices are on the hull, which then has the faces of the cube's grid.
    ball = points / np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(ball).simplices
    corners = ball[faces]
    turned = np.einsum(
        "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]
    )
    faces[turned < 0] = faces[turned < 0][:, ::-1]
    return Mesh(points, faces)


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
    form = variant(name, methods()).create().canonicalise(Shape(identifier=surface, mesh=mesh))
    assert form.vertices.shape == mesh.vertices.shape
    assert np.isfinite(form.vertices).all()
    assert np.ptp(form.vertices, axis=0).max() > 0

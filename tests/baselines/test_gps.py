import numpy as np
import pytest

from baselines.gps import GPS
from benchmark.api.contracts import Shape
from benchmark.geometry.mesh import Mesh
from tests.baselines.embedding import sphere


def grid(width: float, height: float, rows: int, columns: int) -> Mesh:
    x, y = np.meshgrid(np.linspace(0, width, columns), np.linspace(0, height, rows))
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + columns], axis=1),
            np.stack([corner + 1, corner + columns + 1, corner + columns], axis=1),
        ]
    )
    return Mesh(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces)


def test_a_sphere_becomes_a_sphere():
    # Eigenvalue 2 three times; the three functions have squares that sum to 3 / (4 pi), over 2 gives the radius.
    form = GPS().canonicalise(Shape(identifier="sphere", mesh=sphere(1500)))
    np.testing.assert_allclose(np.linalg.norm(form.vertices, axis=1), np.sqrt(3 / (8 * np.pi)), rtol=0.02)
    assert form.notes["eigenvalue_1"] == pytest.approx(8 * np.pi, rel=0.01)
    assert form.notes["eigenvalue_gap_12"] == pytest.approx(0, abs=0.02)
    assert form.notes["eigenvalue_gap_34"] == pytest.approx(2, rel=0.02)


def test_a_rectangle_follows_its_cosines():
    # Neumann spectrum pi^2 (i^2 / a^2 + j^2 / b^2), functions cos(i pi x / a) cos(j pi y / b).
    width, height = 1.0, 0.6
    mesh = grid(width, height, 37, 61)
    form = GPS().canonicalise(Shape(identifier="rectangle", mesh=mesh))
    x, y, _ = mesh.vertices.T
    area = width * height
    cosines = [
        np.sqrt(2 / area) * np.cos(np.pi * x / width) / (np.pi / width),
        np.sqrt(2 / area) * np.cos(np.pi * y / height) / (np.pi / height),
        np.sqrt(4 / area) * np.cos(np.pi * x / width) * np.cos(np.pi * y / height) / (np.pi * np.hypot(1, 1 / height)),
    ]
    for found, expected in zip(form.vertices.T, cosines, strict=True):
        assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < 0.01

import numpy as np
import pytest

from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh
from tests.geometry.surfaces import flat_grid

TRIANGLE = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])


def test_area_by_hand():
    mesh = Mesh(TRIANGLE, [[0, 1, 2]])
    assert mesh.area == 6.0
    np.testing.assert_array_equal(mesh.face_areas, [6.0])
    assert flat_grid(5, spacing=0.5).area == pytest.approx(4.0)


def test_arrays_are_copied_and_read_only():
    vertices = TRIANGLE.copy()
    mesh = Mesh(vertices, [[0, 1, 2]])
    vertices[0] = 99
    assert mesh.vertices[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        mesh.faces[0, 0] = 1


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "NaN"),
        (TRIANGLE, [[0, 1, 3]], "vertex 3"),
        (TRIANGLE, [[-1, 1, 2]], "-1"),
        (TRIANGLE, [[0, 1, 2, 2]], "shape"),
        (TRIANGLE + 0j, [[0, 1, 2]], "vertices are of type complex128, not real numbers"),
        (TRIANGLE.astype(str), [[0, 1, 2]], "vertices are of type <U32, not real numbers"),
        (TRIANGLE, [[0.0, 1.0, 2.0]], "faces are of type float64, not integers"),
        (TRIANGLE, [[0, 1, 2**32 + 2]], "name vertices 0 to 4294967298"),
        ([[0, 0], [1, 0, 0]], [[0, 1, 2]], "vertices are no array"),
    ],
)
def test_what_does_not_fit_together_is_refused(vertices, faces, words):
    with pytest.raises(InvalidMesh, match=words):
        Mesh(vertices, faces)

import igl
import numpy as np
import pytest

from benchmark.errors import UnsupportedShape
from benchmark.geometry.laplacian import cotangent_laplacian, eigenpairs
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from tests.geometry.surfaces import flat_grid, joined, limbed_body, relabelled, sphere

BODY = prepare(limbed_body(), 500).mesh


@pytest.mark.parametrize("mesh", [BODY, sphere(3), flat_grid(7), joined(sphere(1), flat_grid(3))])
def test_agrees_with_libigl(mesh):
    laplacian = cotangent_laplacian(mesh)
    vertices, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
    np.testing.assert_allclose(laplacian.stiffness.toarray(), -igl.cotmatrix(vertices, faces).toarray(), atol=1e-9)
    mass = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()
    np.testing.assert_allclose(laplacian.mass, mass, rtol=1e-12)


@pytest.mark.parametrize("k", [1, 5, 40])
def test_eigenpairs_solve_the_generalised_problem(k):
    laplacian = cotangent_laplacian(BODY)
    values, functions = eigenpairs(laplacian, k)
    assert values.shape == (k,)
    assert (np.diff(values) >= 0).all()
    weighted = laplacian.mass[:, None] * functions
    np.testing.assert_allclose(functions.T @ weighted, np.eye(k), atol=1e-9)
    np.testing.assert_allclose(laplacian.stiffness @ functions, weighted * values, atol=1e-8 * max(values[-1], 1))


def test_scale_relabelling_and_rigid_motion():
    values, _ = eigenpairs(cotangent_laplacian(BODY), 6)
    for scale in (1e-6, 1e6):
        scaled, _ = eigenpairs(cotangent_laplacian(BODY.with_vertices(scale * BODY.vertices)), 6)
        np.testing.assert_allclose(scaled[1:] * scale**2, values[1:], rtol=1e-7)
    other, _ = relabelled(BODY)
    np.testing.assert_allclose(eigenpairs(cotangent_laplacian(other), 6)[0][1:], values[1:], rtol=1e-7)
    rotation, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    moved = BODY.with_vertices(BODY.vertices @ rotation.T + 7)
    np.testing.assert_allclose(eigenpairs(cotangent_laplacian(moved), 6)[0][1:], values[1:], rtol=1e-7)


def test_slivers_and_flat_triangles_do_not_spoil_the_matrix():
    """A needle, a triangle without area and an unreferenced vertex beside a good square."""
    mesh = Mesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, -1e-9, 0], [2, 0, 0], [5, 5, 5]],
        [[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 1, 5]],
    )
    laplacian = cotangent_laplacian(mesh)
    matrix = laplacian.stiffness.toarray()
    assert np.isfinite(matrix).all()
    assert np.abs(matrix).max() < 2e3
    assert np.linalg.eigvalsh(matrix).min() > -1e-9
    assert (laplacian.mass > 0).all()
    assert np.isfinite(eigenpairs(laplacian, 3)[1]).all()


def test_faults():
    with pytest.raises(UnsupportedShape, match="no area"):
        cotangent_laplacian(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
    with pytest.raises(UnsupportedShape, match="no area"):
        cotangent_laplacian(Mesh(np.empty((0, 3)), np.empty((0, 3))))
    for k in (0, 13):
        with pytest.raises(UnsupportedShape, match="1 to 12"):
            eigenpairs(cotangent_laplacian(sphere(0)), k)

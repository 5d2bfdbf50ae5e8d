"""A shape stands in its own frame, whatever that of the file is."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from benchmark.geometry.mesh import Mesh
from learned.template.frame import centred, principal_axes, quarter_turns


def lump() -> Mesh:
    """Nothing about it is symmetric."""
    sphere = trimesh.creation.icosphere(subdivisions=2)
    x, y, z = sphere.vertices.T
    return Mesh(np.stack([x * (1 + 0.3 * z), 2 * y + 0.4 * x**2, 3 * z + 0.5 * y**2], axis=1), sphere.faces)


def standing(mesh: Mesh) -> np.ndarray:
    still = centred(mesh)
    return still.vertices @ principal_axes(still).T


def test_the_frame_moves_turns_and_grows_with_the_shape() -> None:
    mesh = lump()
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.3]).as_matrix()
    moved = mesh.with_vertices(7 * mesh.vertices @ turn.T + [3, -1, 2])
    np.testing.assert_allclose(standing(moved), standing(mesh), atol=1e-9)


def test_the_frame_is_the_same_whatever_the_numbering() -> None:
    mesh = lump()
    order = np.random.default_rng(0).permutation(mesh.n_vertices)
    renumbered = Mesh(mesh.vertices[order], np.roll(np.argsort(order)[mesh.faces][::-1], 1, axis=1))
    np.testing.assert_allclose(standing(renumbered), standing(mesh)[order], atol=1e-9)


def test_a_box_stands_along_its_edges_the_longest_first() -> None:
    box = trimesh.creation.box((1, 3, 2))
    still = centred(Mesh(np.add(box.vertices, 5), box.faces))
    assert np.isclose(still.area, 1)
    np.testing.assert_allclose(still.vertices.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(principal_axes(still)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-9)


def test_the_quarter_turns_are_the_rotations_of_a_cube() -> None:
    turns = quarter_turns()
    assert np.allclose(np.linalg.det(turns), 1)
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3))
    known = {turn.tobytes() for turn in turns.round() + 0.0}
    assert len(known) == 24
    assert {(one @ other + 0.0).tobytes() for one in turns for other in turns} == known

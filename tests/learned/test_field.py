"""The field answers alike however a surface is given, and keeps the detail of its input."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.api.contracts import Shape
from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh
from learned.field import even_samples, in_frame, with_detail
from tests.geometry.surfaces import flat_grid, limbed_body, relabelled, sphere

BODY = limbed_body()
BOX = trimesh.creation.box((1.0, 1.0, 3.0))
SYMMETRIC = {"box": Mesh(BOX.vertices, BOX.faces), "ball": sphere(2), "sheet": flat_grid(4)}


def test_numbering_division_and_rigid_motion_leave_no_trace_in_the_frame() -> None:
    framed = in_frame(BODY).vertices
    other, new = relabelled(BODY, 3)
    other = Mesh(other.vertices, np.roll(other.faces[::-1], 1, axis=1))
    assert np.abs(in_frame(other).vertices[new] - framed).max() < 1e-9
    fine = trimesh.Trimesh(BODY.vertices, BODY.faces, process=False).subdivide()
    assert (
        np.abs(in_frame(Mesh(fine.vertices, fine.faces)).vertices[: BODY.n_vertices] - framed).max()
        < 1e-9
    )
    moved = BODY.with_vertices(BODY.vertices[:, [1, 2, 0]] * 30 + 7)
    assert np.abs(in_frame(moved).vertices - framed).max() < 1e-9


@pytest.mark.parametrize("name", SYMMETRIC)
def test_a_symmetric_shape_has_a_frame_and_lies_at_the_origin(name: str) -> None:
    framed = in_frame(SYMMETRIC[name])
    assert framed.area == pytest.approx(1)
    assert framed.face_areas @ framed.vertices[framed.faces].mean(axis=1) == pytest.approx(
        np.zeros(3), abs=1e-12
    )


def test_a_surface_without_area_is_refused() -> None:
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(UnsupportedShape, match="no area"):
        in_frame(flat)
    with np.errstate(all="ignore"), pytest.raises(UnsupportedShape, match="scale the mesh"):
        in_frame(BODY.with_vertices(BODY.vertices * 1e160))


@pytest.mark.parametrize(
    "mesh", [in_frame(BODY), sphere(2), in_frame(flat_grid(6))], ids=["body", "sphere", "grid"]
)
@pytest.mark.kernels
def test_samples_do_not_depend_on_the_numbering(mesh: Mesh) -> None:
    """Not even where all distances tie, as on a grid."""
    (one, one_normals), (other, other_normals) = (
        even_samples(mesh, 100),
        even_samples(relabelled(mesh, 1)[0], 100),
    )
    assert np.abs(one - other).max() < 1e-9
    assert np.abs(one_normals - other_normals).max() < 1e-6


def test_rotated_positions_and_rotations_give_the_input_rotated() -> None:
    shape = Shape(identifier="x", mesh=in_frame(BODY))
    rest, turn = shape.mesh.vertices, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    rotations = np.broadcast_to(turn, (len(rest), 3, 3))
    form = with_detail(rest, shape.laplacian(), rest @ turn.T, rotations, reach=0.1, rounds=2)
    assert np.abs(form - rest @ turn.T).max() < 1e-6
    noisy = rest @ turn.T + np.random.default_rng(0).normal(scale=0.02, size=rest.shape)
    refined = with_detail(rest, shape.laplacian(), noisy, rotations, reach=0.1, rounds=2)
    assert np.abs(refined - rest @ turn.T).mean() < 0.4 * np.abs(noisy - rest @ turn.T).mean()
    assert with_detail(rest, shape.laplacian(), noisy, rotations, reach=0, rounds=2) is noisy

"""The frame of a surface turns with it, and knows nothing of how it is divided."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh
from learned.frame import centred, frame_of, of_unit_area
from tests.geometry.surfaces import limbed_body, relabelled

BODY = limbed_body()


def symmetric_shapes() -> dict[str, Mesh]:
    made = {
        "box": trimesh.creation.box((1.0, 2.0, 3.0)),
        "cube": trimesh.creation.box((1.0, 1.0, 1.0)),
        "ball": trimesh.creation.icosphere(subdivisions=2),
        "tube": trimesh.creation.cylinder(radius=0.3, height=2.0),
        "cone": trimesh.creation.cone(radius=0.5, height=1.0),
    }
    sheet = Mesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]])
    return {name: Mesh(each.vertices, each.faces) for name, each in made.items()} | {"sheet": sheet}


def inside(mesh: Mesh) -> np.ndarray:
    return frame_of(mesh).seen(mesh).vertices


def test_numbering_and_division_leave_no_trace():
    other, new = relabelled(BODY, 3)
    other = Mesh(other.vertices, np.roll(other.faces[::-1], 1, axis=1))
    assert np.abs(inside(other)[new] - inside(BODY)).max() < 1e-9
    fine = trimesh.Trimesh(BODY.vertices, BODY.faces, process=False).subdivide()
    frame = frame_of(Mesh(fine.vertices, fine.faces))
    assert np.abs(frame.axes - frame_of(BODY).axes).max() < 1e-9
    assert np.abs(frame.origin - frame_of(BODY).origin).max() < 1e-9


@pytest.mark.parametrize("name", symmetric_shapes())
def test_a_symmetric_shape_has_a_proper_frame_and_lies_at_the_origin(name):
    mesh = symmetric_shapes()[name]
    frame = frame_of(mesh)
    assert np.linalg.det(frame.axes) == pytest.approx(1)
    assert frame.axes @ frame.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert_centred(frame.seen(mesh))


def assert_centred(mesh: Mesh) -> None:
    assert mesh.area == pytest.approx(1)
    assert mesh.face_areas @ mesh.vertices[mesh.faces].mean(axis=1) == pytest.approx(np.zeros(3), abs=1e-12)


def test_training_turns_a_frame_a_little_and_flips_it_where_it_nearly_ties():
    random = np.random.default_rng(0)
    axes = np.array([frame_of(BODY, random).axes for _ in range(100)])
    assert np.linalg.det(axes) == pytest.approx(np.ones(100))
    turns = np.einsum("nij,ij->n", axes, frame_of(BODY).axes)
    assert len(set(np.round(turns, 6))) == 100
    ball = symmetric_shapes()["ball"]
    axes = np.array([frame_of(ball, random).axes for _ in range(200)])
    assert np.abs(axes.mean(axis=0)).max() < 0.2


def test_what_has_no_frame_is_refused():
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    cloud = Mesh(BODY.vertices, np.empty((0, 3), dtype=np.int32))
    infinite = BODY.with_vertices(BODY.vertices * 1e160)
    for place in (frame_of, centred):
        for mesh in (flat, cloud):
            with pytest.raises(UnsupportedShape, match="no area"):
                place(mesh)
        with np.errstate(all="ignore"), pytest.raises(UnsupportedShape, match="scale the mesh"):
            place(infinite)


def test_what_a_network_makes_is_scaled_or_refused():
    scaled = BODY.with_vertices(of_unit_area(BODY, 3 * BODY.vertices))
    assert scaled.area == pytest.approx(1)
    for vertices in (np.zeros_like(BODY.vertices), np.full_like(BODY.vertices, np.nan)):
        with pytest.raises(UnsupportedShape, match="leaves no surface"):
            of_unit_area(BODY, vertices)

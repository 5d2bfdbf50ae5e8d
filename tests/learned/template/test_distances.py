"""The signed distance along a ray is how far one went, for any surface with an inside."""

import numpy as np
import pytest
import trimesh

from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh
from learned.frame import centred
from learned.template.distances import NEAR, rays_around

RADIUS = 1 / np.sqrt(4 * np.pi)
"""Of the sphere whose area is 1."""


def sphere(subdivisions: int = 3) -> Mesh:
    found = trimesh.creation.icosphere(subdivisions=subdivisions)
    return centred(Mesh(found.vertices, found.faces))


def test_the_distances_to_a_sphere_are_those_to_its_centre_less_the_radius() -> None:
    rays = rays_around(sphere(), 400)
    assert rays.lengths.shape == (400,)
    for share in (0, 0.3, 1):
        points = rays.feet + share * rays.lengths[:, None] * rays.directions
        np.testing.assert_allclose(np.linalg.norm(points, axis=1) - RADIUS, share * rays.lengths, atol=0.004)
    assert 10 < (rays.lengths < 0).sum() < 200
    assert np.mean(np.abs(rays.lengths) <= NEAR) == pytest.approx(0.75, abs=0.01)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1, atol=1e-5)
    assert np.einsum("nk,nk->n", rays.directions, rays.feet).min() > 0.9 * RADIUS


def test_any_first_part_of_the_rays_has_near_and_far_ones() -> None:
    lengths = np.abs(rays_around(sphere(), 400).lengths[:40])
    assert 0.6 < np.mean(lengths <= NEAR) < 0.9


def test_a_surface_inside_out_and_one_with_a_hole_have_the_same_inside() -> None:
    mesh = sphere()
    expected = rays_around(mesh, 200)
    for faces in (mesh.faces[:, ::-1], mesh.faces[20:]):
        found = rays_around(Mesh(mesh.vertices, faces), 200)
        assert np.mean(np.sign(found.lengths) == np.sign(expected.lengths)) > 0.99


def test_a_sheet_has_no_inside() -> None:
    places = np.linspace(-0.5, 0.5, 6)
    vertices = np.stack([*np.meshgrid(places, places), np.zeros((6, 6))], axis=-1).reshape(-1, 3)
    corner = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    one, other = np.stack([corner, corner + 1, corner + 7], 1), np.stack([corner, corner + 7, corner + 6], 1)
    with pytest.raises(UnsupportedShape, match="encloses nothing"):
        rays_around(Mesh(vertices, np.concatenate([one, other])), 200)

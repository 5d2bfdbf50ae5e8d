from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from benchmark.errors import InvalidMesh
from benchmark.geometry.rasterise import depth_buffer

pytestmark = pytest.mark.kernels

SIZE = 96


def test_the_nearer_triangle_wins_whatever_the_order_and_winding() -> None:
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]])
    points = np.concatenate([np.c_[square, np.full(4, 2.0)], np.c_[square, [1.0, 3.0, 3.0, 1.0]]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    image = depth_buffer(points, faces, 4, 0.0)
    np.testing.assert_allclose(image, np.tile([1.25, 1.75, 2.0, 2.0], (4, 1)), atol=1e-6)
    for shuffled in (faces[::-1], faces[:, ::-1], np.roll(faces, 1, axis=1)):
        np.testing.assert_allclose(depth_buffer(points, shuffled, 4, 0.0), image, atol=1e-6)


def test_agrees_with_ray_casting() -> None:
    pytest.importorskip("embreex")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    knot = trimesh.creation.torus(30, 12, major_sections=40, minor_sections=20)
    blob = trimesh.creation.icosphere(subdivisions=3, radius=22)
    scene = trimesh.util.concatenate([knot, blob.apply_translation([20.3, 7.1, 5.0])])
    turned = scene.vertices @ Rotation.random(rng=1).as_matrix().T
    points = turned * [1, 1, 0.5] + [SIZE / 2 + 0.013, SIZE / 2 - 0.027, 0]
    image = depth_buffer(points, scene.faces, SIZE, np.nan)

    columns, rows = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    origins = np.stack([columns.ravel(), rows.ravel(), np.full(SIZE**2, -200.0)], axis=1)
    mesh = trimesh.Trimesh(points, scene.faces, process=False)
    hits, rays, _ = RayMeshIntersector(mesh).intersects_location(
        origins, np.tile([0.0, 0, 1], (SIZE**2, 1)), multiple_hits=False
    )
    expected = np.full(SIZE**2, np.nan)
    expected[rays] = hits[:, 2]
    expected = expected.reshape(SIZE, SIZE)
    assert 2000 < len(rays) < SIZE**2
    # Rays that graze a silhouette may fall on either side.
    assert (np.isnan(expected) != np.isnan(image)).sum() <= 2
    both = ~np.isnan(expected) & ~np.isnan(image)
    assert np.quantile(np.abs(image - expected)[both], 0.999) < 1e-3


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), snap=st.sampled_from([0.0, 0.5, 1.0]))
def test_no_cracks_inside_a_triangulated_square(seed: int, snap: float) -> None:
    # Vertices on pixel centres and corners are the hard case: the centre lies on edges and vertices exactly.
    inner = np.random.default_rng(seed).uniform(0, 24, (60, 2))
    inner = np.round(inner / snap) * snap if snap else inner
    flat = np.unique(np.concatenate([inner, [[-1, -1], [25, -1], [25, 25], [-1, 25]]]), axis=0)
    image = depth_buffer(np.c_[flat, flat[:, 0]], Delaunay(flat).simplices, 24, np.inf)
    np.testing.assert_allclose(image, np.tile(np.arange(24) + 0.5, (24, 1)), atol=1e-4)


def test_parts_outside_are_cut_off_and_shifts_move_pixels() -> None:
    rng = np.random.default_rng(3)
    points, faces = rng.uniform(-10, 40, (30, 3)), rng.integers(0, 30, (20, 3))
    image = depth_buffer(points, faces, 32, -1.0)
    shifted = depth_buffer(points + np.array([5, 3, 0]), faces, 32, -1.0)
    np.testing.assert_allclose(shifted[3:, 5:], image[:-3, :-5], atol=1e-4)
    assert (depth_buffer(points + np.array([500, 0, 0]), faces, 32, -1.0) == -1).all()


@pytest.mark.parametrize(
    ("points", "faces", "message"),
    [
        ([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "NaN"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "does not exist"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "shape"),
    ],
)
def test_faults_are_named(points: ArrayLike, faces: ArrayLike, message: str) -> None:
    with pytest.raises(InvalidMesh, match=message):
        depth_buffer(points, faces, 4, 0.0)

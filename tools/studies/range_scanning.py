"""Scans of validation bodies: range images from some sides, fused by screened Poisson reconstruction.

The third recipe of scans of people. What is trained on is welded, wrapped, slipped and patched triangles of the body
(:mod:`benchmark.datasets.scans`); ``humans-scanlike`` is a solid of voxels. Here nothing but points of depth images
remains of the body, and the skin is the one that their normals imply.
"""

from __future__ import annotations

import numpy as np
import pymeshlab

from benchmark.geometry.cleaning import largest_component
from benchmark.geometry.mesh import Mesh, Points
from benchmark.geometry.rasterise import depth_buffer

COLUMNS, TILTS = 4, (-20.0, 0.0, 25.0)
"""Cameras around the body, and the angles in degrees at which each column has one, upwards and downwards."""

PIXELS = 256
"""Pixels per side of each image, which the body fills."""

GRAZING = 0.25
"""Least cosine between the line of sight and the normal of what is measured."""

RANGE_NOISE = 0.0012
"""Standard deviation in metres of the noise of a range."""

STEP = 0.002
"""Coordinates are multiples of it, in metres."""

MOST_POINTS = 15_000
"""Points that are kept, drawn from all."""

DEPTH = 7
"""Depth of the octree of the reconstruction: cells of 2 centimetres, so that fingers and armpits close."""

FAREST = 0.03
"""Distance from every point, in metres, beyond which half of the scans have no surface."""


def range_scan(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Surface of a body in metres that stands along z, as range cameras and a reconstruction leave it.

    Parameters
    ----------
    mesh
        A surface that looks outward.
    random
        Source of the cameras' places, of the noise, and of which points are kept.
    """
    first = random.uniform(0, 360)
    views = [(first + 360 * column / COLUMNS, tilt) for column in range(COLUMNS) for tilt in TILTS]
    made = [_seen(mesh, *np.radians(view), random) for view in views]
    points, normals = (np.concatenate(part) for part in zip(*made, strict=True))
    chosen = random.permutation(len(points))[:MOST_POINTS]
    skin = _reconstructed(np.round(points[chosen] / STEP) * STEP, normals[chosen])
    if random.random() < 0.5:
        skin = _near(skin, points[chosen])
    return largest_component(skin)


def _seen(mesh: Mesh, turn: float, tilt: float, random: np.random.Generator) -> tuple[Points, Points]:
    """Points that a camera measures, with their normals, shape (n, 3) each."""
    ahead = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    right = np.cross([0, 0, 1.0], ahead)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    points = mesh.vertices @ axes.T
    low = points[:, :2].min(axis=0)
    pixel = np.ptp(points[:, :2], axis=0).max() / PIXELS
    image = depth_buffer(
        np.column_stack([(points[:, :2] - low) / pixel, points[:, 2]]), mesh.faces, PIXELS, np.inf
    ).astype(np.float64)
    hit = np.isfinite(image)
    image[~hit] = np.nan
    rows, columns = np.gradient(image, pixel)
    normals = np.dstack([columns, rows, -np.ones_like(image)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    measured = hit & (-normals[..., 2] > GRAZING)
    row, column = np.nonzero(measured)
    ranges = image[measured] + random.normal(scale=RANGE_NOISE, size=len(row))
    found = np.column_stack([(column + 0.5) * pixel + low[0], (row + 0.5) * pixel + low[1], ranges])
    return found @ axes, normals[measured] @ axes


def _reconstructed(points: Points, normals: Points) -> Mesh:
    """Screened Poisson reconstruction [Kazhdan and Hoppe 2013]."""
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(vertex_matrix=points, v_normals_matrix=normals))
    work.generate_surface_reconstruction_screened_poisson(depth=DEPTH, threads=1)
    return Mesh(work.current_mesh().vertex_matrix(), work.current_mesh().face_matrix())


def _near(mesh: Mesh, points: Points) -> Mesh:
    """Surface without the triangles that no point is near."""
    from scipy.spatial import cKDTree

    far = cKDTree(points).query(mesh.vertices)[0] > FAREST
    return Mesh(mesh.vertices, mesh.faces[~far[mesh.faces].all(axis=1)])

"""Pictures of meshes and depth images without OpenGL: the scorer's own rasteriser and a lamp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.rasterise import depth_buffer

Image = NDArray[np.float64]

#: Pixels are drawn this many times finer and averaged, so that outlines are smooth.
SUPERSAMPLING = 3

#: Towards the lamp, in image coordinates: right, up, towards the viewer.
LAMP = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])

_COLOUR = np.array([0.62, 0.70, 0.78])


def shaded(mesh: Mesh, camera: Camera = FRONT, size: int = 200) -> Image:
    """Picture of a mesh that fills the image.

    Parameters
    ----------
    mesh
        The shape.
    camera
        Viewing direction.
    size
        Pixels per side.

    Returns
    -------
    numpy.ndarray
        Shape (size, size, 3), in [0, 1], white where there is nothing.
    """
    points = mesh.vertices @ camera.rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(float((high - low)[:2].max()) / 2, 1e-12) / 0.94
    points = (points - (low + high) / 2) / half
    fine = size * SUPERSAMPLING
    pixels = np.column_stack([(1 + points[:, 0]) * fine / 2, (1 - points[:, 1]) * fine / 2, -points[:, 2]])
    depth = depth_buffer(pixels, mesh.faces, fine, np.inf).astype(np.float64)
    seen = np.isfinite(depth)
    return averaged(_lit(depth, seen, 2 / fine), size)


def depth_picture(depth: NDArray[np.float32], size: int = 200) -> Image:
    """Picture of a depth image: near is bright, background is white."""
    seen = depth > 0
    step = max(len(depth) // size, 1)
    if not seen.any():
        return np.ones((len(depth) // step, len(depth) // step, 3))
    low, high = float(depth[seen].min()), float(depth[seen].max())
    grey = np.where(seen, 0.15 + 0.75 * (depth - low) / max(high - low, 1e-9), 1.0)
    return np.repeat(grey[::step, ::step, None], 3, axis=2)


def principal_frame(mesh: Mesh) -> Mesh:
    """The mesh turned so that its longest axis is upright and its shortest one looks at the viewer.

    The forms of most methods have no orientation of their own; this one shows them at their widest.
    """
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    turned = centred @ axes.T
    # Longest axis upwards (z), second across (x), shortest along the view (y); heavier tails up and right.
    turned = turned[:, [1, 2, 0]] * np.where((turned[:, [1, 2, 0]] ** 3).sum(axis=0) < 0, -1.0, 1.0)
    return mesh.with_vertices(turned)


def _lit(depth: Image, seen: NDArray[np.bool_], pixel: float) -> Image:
    """Light a depth map by the normals that its differences give."""
    filled = np.where(seen, depth, np.max(depth, where=seen, initial=0.0))
    down, right = np.gradient(filled, pixel)
    normal = np.stack([right, -down, np.ones_like(filled)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = 0.35 + 0.65 * np.clip(normal @ LAMP, 0, 1)
    coloured = np.clip(light[..., None] * _COLOUR * 1.25, 0, 1)
    return np.asarray(np.where(seen[..., None], coloured, 1.0))


def averaged(image: Image, size: int) -> Image:
    """Average a picture that was drawn finer, by :data:`SUPERSAMPLING`, onto its pixels."""
    blocks = image.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3)
    return np.asarray(blocks.mean(axis=(1, 3)))

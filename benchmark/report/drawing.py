"""Draw surfaces without OpenGL, with the scorer's rasteriser and simple shading.

On coloured surfaces, the colour shows how far a point is from the centre of the body.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh, Points
from benchmark.geometry.rasterise import depth_buffer

#: Direction of the light in image coordinates: right, up, towards the viewer.
_LAMP = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])

#: Colours from the trunk to the tips of the limbs; distinct on white and black, and by lightness
#: alone.
PALETTE = ("#4a62b0", "#3a82be", "#4aaca8", "#96d088", "#f4d264", "#f69e5c")
_RAMP = np.array([[int(name[k : k + 2], 16) for k in (1, 3, 5)] for name in PALETTE]) / 255
_PLAIN = np.array([0.60, 0.68, 0.77])

#: View of forms, whose errors in depth do not show from the front.
OBLIQUE = Camera((-0.9, 0.0, -1.0), (0.0, 1.0, 0.0))

#: File extensions of pictures and figures.
ENDINGS = (".png", ".pdf", ".svg")

_FINER = 2


def outwardness(mesh: Mesh) -> NDArray[np.float64]:
    """Return how far each vertex is from the centre of its surface, shape (n,): 0 at the centre, 1 at the farthest tip.

    This averages the mean distance along edges to samples all over the surface, scaled to [0, 1],
    and its rank. Both hardly change when a limb bends, so each part of a body has the same colour
    in every pose.
    """
    sources = np.unique(np.linspace(0, mesh.n_vertices - 1, 48).astype(int))
    along = dijkstra(mesh.edge_graph(), indices=sources)
    along[~np.isfinite(along)] = np.nan
    far = np.nan_to_num(np.nanmean(along, axis=0))
    share = (far - far.min()) / max(float(np.ptp(far)), 1e-12)
    rank = np.argsort(np.argsort(far, kind="stable"), kind="stable") / max(len(far) - 1, 1)
    return np.asarray(
        (share + rank) / 2
    )  # most of a body is trunk, which would have a single colour without this step


def colours_of(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours of values from 0 to 1, red, green, blue and opacity, shape (n, 4)."""
    places = np.linspace(0, 1, len(_RAMP))
    channels = [np.interp(values, places, channel) for channel in _RAMP.T]
    opaque = np.ones(len(values))
    return np.round(255 * np.stack([*channels, opaque], axis=-1)).astype(np.uint8)


def shaded(
    mesh: Mesh,
    camera: Camera,
    size: int,
    values: NDArray[np.float64] | None = None,
    frame: Points | None = None,
) -> Image.Image:
    """Draw a mesh as a camera sees it; its surroundings are transparent.

    Parameters
    ----------
    mesh
        The surface.
    camera
        The camera.
    size
        Pixels per side.
    values
        Value of each vertex from 0 to 1, shown as colour; None for one colour.
    frame
        Points that the picture has room for, shape (n, 3); by default those of the mesh.
    """
    points, held = (
        each @ camera.rotation.T
        for each in (mesh.vertices, mesh.vertices if frame is None else frame)
    )
    low, high = held.min(axis=0), held.max(axis=0)
    half = max(float((high - low)[:2].max()) / 2, 1e-12) / 0.94
    scaled, fine = (points - (low + high) / 2) / half, size * _FINER
    pixels = np.column_stack(
        [(1 + scaled[:, 0]) * fine / 2, (1 - scaled[:, 1]) * fine / 2, -scaled[:, 2]]
    )
    depth = depth_buffer(pixels, mesh.faces, fine, np.inf).astype(np.float64)
    seen = np.isfinite(depth)
    picture = np.zeros((fine, fine, 4))
    if seen.any():
        colours = _PLAIN if values is None else _surface_colours(scaled, depth, seen, values)
        picture[seen, :3] = np.clip(colours * _light(depth, seen)[:, None], 0, 1)
        picture[seen, 3] = 1
    blocks = np.mean(
        [picture[k::_FINER, j::_FINER] for k in range(_FINER) for j in range(_FINER)], axis=0
    )
    blocks[..., :3] /= np.maximum(blocks[..., 3:], 1e-9)
    return Image.fromarray(np.round(255 * blocks).astype(np.uint8))


def _surface_colours(
    scaled: Points, depth: NDArray[np.float64], seen: NDArray[np.bool_], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    rows, columns = np.nonzero(seen)
    # Pixels that become one have one colour.
    _, first, block = np.unique(
        rows // _FINER * len(depth) + columns // _FINER, return_index=True, return_inverse=True
    )
    places = np.column_stack(
        [(columns + 0.5) * 2 / len(depth) - 1, 1 - (rows + 0.5) * 2 / len(depth), -depth[seen]]
    )
    away, nearest = cKDTree(scaled).query(places[first], k=range(1, min(3, len(scaled)) + 1))
    shown = np.average(values[nearest], axis=1, weights=1 / np.maximum(away, 1e-6))[block]
    return np.stack(
        [np.interp(shown, np.linspace(0, 1, len(_RAMP)), channel) for channel in _RAMP.T], axis=-1
    )


def _light(depth: NDArray[np.float64], seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the brightness of each pixel of the surface: directional and ambient light, and a dark rim."""
    filled = np.where(seen, depth, np.max(depth, where=seen, initial=-np.inf))
    down, right = np.gradient(filled, 2 / len(depth))
    normal = np.stack([right[seen], -down[seen], np.ones(int(seen.sum()))], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(0.52 + 0.62 * np.clip(normal @ _LAMP, 0, 1) * (0.55 + 0.45 * normal[:, 2]))


def webp(image: Image.Image, quality: int = 80) -> bytes:
    """Return a picture as WebP."""
    image.save(stream := io.BytesIO(), format="WEBP", quality=quality, alpha_quality=quality)
    return stream.getvalue()


def check_ending(path: Path | None) -> None:
    """Raise ``ConfigurationError`` for a picture that cannot be written, if one is wanted, before all computations."""
    if path is not None and path.suffix.lower() not in ENDINGS:
        raise ConfigurationError(
            f"{path} is not the name of a picture", f"use {', '.join(ENDINGS)}"
        )

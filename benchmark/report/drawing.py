"""Draw surfaces without OpenGL, with the scorer's rasteriser and simple shading.

On coloured surfaces, the colour shows how far a point is from the centre of the body.
"""

from __future__ import annotations

import io
from itertools import product
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
_TO_LAMP = np.array([-0.4, 0.6, 0.7])
_LAMP = _TO_LAMP / np.linalg.norm(_TO_LAMP)

#: Colours from the trunk to the tips of the limbs; distinct on white and black, and by lightness
#: alone.
PALETTE = ("#4a62b0", "#3a82be", "#4aaca8", "#96d088", "#f4d264", "#f69e5c")

#: The same as red, green and blue from 0 to 1, shape (6, 3).
_RAMP = np.array([[*bytes.fromhex(name[1:])] for name in PALETTE]) / 255

#: Colour of a surface without values.
_PLAIN = np.array([0.60, 0.68, 0.77])

#: View of forms, whose errors in depth do not show from the front.
OBLIQUE = Camera((-0.9, 0.0, -1.0), (0.0, 1.0, 0.0))

#: File extensions of pictures and figures.
ENDINGS = (".png", ".pdf", ".svg")

#: Pixels that are drawn for one of a picture, along each side.
_FINER = 2

#: Least half of the side of a frame, so that a single point has one.
_LEAST_HALF = 1e-12

#: Least distance between a pixel and a vertex, which bounds the weight of the vertex.
_LEAST_DISTANCE = 1e-6

#: Share of the side of a picture that a surface takes.
_FILLED = 0.94

#: Samples of a surface from which :func:`outwardness` measures distances.
_SAMPLES = 48


def outwardness(mesh: Mesh) -> NDArray[np.float64]:
    """Return how far each vertex is from the centre of its surface, shape (n,).

    It is 0 at the centre and 1 at the farthest tip: the mean distance along edges to samples all
    over the surface, scaled to [0, 1], averaged with its rank. Both hardly change when a limb
    bends, so each part of a body has the same colour in every pose.
    """
    sources = np.unique(np.linspace(0, mesh.n_vertices - 1, _SAMPLES).astype(int))
    along = dijkstra(mesh.edge_graph(), indices=sources)
    along[~np.isfinite(along)] = np.nan
    far = np.nan_to_num(np.nanmean(along, axis=0))
    share = (far - far.min()) / max(float(np.ptp(far)), 1e-12)
    rank = np.argsort(np.argsort(far, kind="stable"), kind="stable") / max(len(far) - 1, 1)
    # Most of a body is trunk, which would have a single colour without its rank.
    return np.asarray((share + rank) / 2)


def colours_of(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours of values from 0 to 1, red, green, blue and opacity, shape (n, 4)."""
    opaque = np.ones((len(values), 1))
    return np.round(255 * np.hstack([_ramp(values), opaque])).astype(np.uint8)


def _ramp(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colours of values from 0 to 1: red, green and blue from 0 to 1, shape (n, 3)."""
    places = np.linspace(0, 1, len(_RAMP))
    return np.column_stack([np.interp(values, places, channel) for channel in _RAMP.T])


def shaded(
    mesh: Mesh,
    camera: Camera,
    size: int,
    values: NDArray[np.float64] | None = None,
    frame: Points | None = None,
) -> Image.Image:
    """Draw a mesh with light and shade, on a transparent background.

    Parameters
    ----------
    mesh
        The surface.
    camera
        The camera that sees it.
    size
        Pixels per side.
    values
        Value of each vertex from 0 to 1, shown as colour; None for one colour.
    frame
        Points that fill the picture, shape (n, 3); by default those of the mesh.
    """
    framed = mesh.vertices if frame is None else frame
    scaled = _in_picture(mesh.vertices, framed, camera)
    # Draw it with more pixels than asked for; it is reduced at the end, which smooths its edges.
    fine = size * _FINER
    columns = (1 + scaled[:, 0]) * fine / 2
    rows = (1 - scaled[:, 1]) * fine / 2
    pixels = np.column_stack([columns, rows, -scaled[:, 2]])
    depth = depth_buffer(pixels, mesh.faces, fine, np.inf).astype(np.float64)
    is_surface = np.isfinite(depth)

    picture = np.zeros((fine, fine, 4))  # red, green, blue and opacity from 0 to 1
    if is_surface.any():
        colours = _PLAIN
        if values is not None:
            colours = _surface_colours(scaled, depth, is_surface, values)
        light = _light(depth, is_surface)[:, None]
        picture[is_surface, :3] = np.clip(colours * light, 0, 1)
        picture[is_surface, 3] = 1
    return Image.fromarray(np.round(255 * _reduced(picture)).astype(np.uint8))


def _reduced(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a picture with one pixel for each block, whose colours are weighted by opacity."""
    offsets = product(range(_FINER), repeat=2)
    blocks = np.mean([picture[down::_FINER, right::_FINER] for down, right in offsets], axis=0)
    blocks[..., :3] /= np.maximum(blocks[..., 3:], 1e-9)
    return np.asarray(blocks)


def _in_picture(points: Points, frame: Points, camera: Camera) -> Points:
    """Return points as a camera sees them, shape (n, 3); the picture is [-1, 1] x [-1, 1].

    Parameters
    ----------
    points
        The points.
    frame
        Points that fill most of the picture, which is centred on them.
    camera
        The camera, which is orthographic.
    """
    turned = frame @ camera.rotation.T
    low = turned.min(axis=0)
    high = turned.max(axis=0)
    half = max(float((high - low)[:2].max()) / 2, _LEAST_HALF) / _FILLED
    return np.asarray((points @ camera.rotation.T - (low + high) / 2) / half)


def _surface_colours(
    scaled: Points,
    depth: NDArray[np.float64],
    is_surface: NDArray[np.bool_],
    values: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the colour of each pixel of a surface, from the values of the three nearest vertices.

    Parameters
    ----------
    scaled
        Vertices as the camera sees them, shape (v, 3); the image is [-1, 1] x [-1, 1].
    depth
        Depth of each pixel of the image, shape (side, side).
    is_surface
        The n pixels that show the surface, shape (side, side).
    values
        Value of each vertex from 0 to 1, shape (v,).

    Returns
    -------
    numpy.ndarray
        Red, green and blue from 0 to 1, shape (n, 3).
    """
    side = len(depth)
    rows, columns = np.nonzero(is_surface)
    # Each block of pixels will become one pixel, so that all of it gets the colour of its first.
    blocks = rows // _FINER * side + columns // _FINER
    _, first, block = np.unique(blocks, return_index=True, return_inverse=True)
    points = np.column_stack(  # the surface at the middle of each pixel
        [(columns + 0.5) * 2 / side - 1, 1 - (rows + 0.5) * 2 / side, -depth[is_surface]]
    )
    n_nearest = min(3, len(scaled))
    away, nearest = cKDTree(scaled).query(points[first], k=range(1, n_nearest + 1))
    weights = 1 / np.maximum(away, _LEAST_DISTANCE)
    return _ramp(np.average(values[nearest], axis=1, weights=weights)[block])


def _light(depth: NDArray[np.float64], is_surface: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the brightness of each pixel of a surface.

    It has directional and ambient light, and a dark rim.
    """
    farthest = np.max(depth, where=is_surface, initial=-np.inf)
    down, right = np.gradient(np.where(is_surface, depth, farthest), 2 / len(depth))
    towards = np.ones(int(is_surface.sum()))
    normal = np.stack([right[is_surface], -down[is_surface], towards], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    rim = 0.55 + 0.45 * normal[:, 2]
    return np.asarray(0.52 + 0.62 * np.clip(normal @ _LAMP, 0, 1) * rim)


def webp(image: Image.Image, quality: int = 80) -> bytes:
    """Return a picture as WebP."""
    stream = io.BytesIO()
    image.save(stream, format="WEBP", quality=quality, alpha_quality=quality)
    return stream.getvalue()


def check_ending(path: Path | None) -> None:
    """Raise ``ConfigurationError`` for a picture that cannot be written, if one is wanted."""
    if path is not None and path.suffix.lower() not in ENDINGS:
        raise ConfigurationError(
            f"{path} is not the name of a picture", f"use {', '.join(ENDINGS)}"
        )

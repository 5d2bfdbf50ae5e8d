"""Render surfaces and depth images without OpenGL, with the scorer's rasteriser and simple shading.

On coloured surfaces, the colour shows how far a point is from the centre of the body.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import write_atomically
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh, Points, edges_of
from benchmark.geometry.rasterise import depth_buffer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Supersampling factor of depth images, for smooth outlines.
SUPERSAMPLING = 3

#: Direction of the light in image coordinates: right, up, towards the viewer.
_LAMP = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])

#: Colours from the trunk to the tips of the limbs; distinct on white and black, and by lightness alone.
_PALETTE = (
    np.array([[74, 98, 176], [58, 130, 190], [74, 172, 168], [150, 208, 136], [244, 210, 100], [246, 158, 92]]) / 255
)
_PLAIN = np.array([0.60, 0.68, 0.77])

_SOURCES = 48
_FINER = 2

#: Origin stated in each figure, so that figures only replace figures of this suite.
SIGNATURE = "canonical-forms benchmark"

#: Metadata by file extension; the defaults would include the time and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": SIGNATURE},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": SIGNATURE},
    ".svg": {"Date": None, "Creator": SIGNATURE},
}

#: File extensions of figures.
ENDINGS = tuple(_UNDATED)


def outwardness(mesh: Mesh) -> NDArray[np.float64]:
    """Return how far each vertex is from the centre of its surface, shape (n,): 0 at the centre, 1 at the farthest tip.

    This averages the mean distance along edges to samples all over the surface, scaled to [0, 1], and its rank. Both
    hardly change when a limb bends, so each part of a body has the same colour in every pose.
    """
    edges = edges_of(mesh.faces).ends
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    graph = coo_matrix((lengths + 1e-12, (edges[:, 0], edges[:, 1])), shape=(mesh.n_vertices,) * 2).tocsr()
    sources = np.unique(np.linspace(0, mesh.n_vertices - 1, _SOURCES).astype(int))
    along = dijkstra(graph, directed=False, indices=sources)
    along[~np.isfinite(along)] = np.nan
    far = np.nan_to_num(np.nanmean(along, axis=0))
    share = (far - far.min()) / max(float(np.ptp(far)), 1e-12)
    rank = np.argsort(np.argsort(far, kind="stable"), kind="stable") / max(len(far) - 1, 1)
    return np.asarray((share + rank) / 2)  # most of a body is trunk, which would have a single colour without this step


def painted(
    points: Points, faces: NDArray[np.int32], values: NDArray[np.float64] | None, size: int, half: float
) -> Image.Image:
    """Render a surface as seen along its third axis, on a transparent background.

    Parameters
    ----------
    points
        Vertices (right, up, towards the viewer) with the origin at the centre of the picture.
    faces
        Triangles.
    values
        Values of the vertices from 0 to 1, shown as colours; None for one colour.
    size
        Pixels per side.
    half
        Half the width of the picture in units of the points.
    """
    fine = size * _FINER
    scaled = points / half
    pixels = np.column_stack([(1 + scaled[:, 0]) * fine / 2, (1 - scaled[:, 1]) * fine / 2, -scaled[:, 2]])
    depth = depth_buffer(pixels, faces, fine, np.inf).astype(np.float64)
    seen = np.isfinite(depth)
    rgba = np.zeros((fine, fine, 4))
    _draw_edges(rgba, pixels, faces, values)
    if seen.any():
        rgba[seen, :3] = _surface_colours(scaled, depth, seen, values, fine) * _light(depth, seen, 2 / fine)[:, None]
        rgba[seen, 3] = 1.0
    blocks = rgba.reshape(size, _FINER, size, _FINER, 4).sum(axis=(1, 3)) / _FINER**2
    blocks[..., :3] = np.clip(blocks[..., :3] / np.maximum(blocks[..., 3:], 1e-9), 0, 1)
    return Image.fromarray(np.round(255 * blocks).astype(np.uint8), "RGBA")


def shaded(mesh: Mesh, camera: Camera = FRONT, size: int = 200) -> Image.Image:
    """Render a mesh in one colour on white, filling the image."""
    points = mesh.vertices @ camera.rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(float((high - low)[:2].max()) / 2, 1e-12) / 0.94
    image = Image.new("RGBA", (size, size), "white")
    image.alpha_composite(painted(points - (low + high) / 2, mesh.faces, None, size, half))
    return image.convert("RGB")


def depth_picture(depth: NDArray[np.float32], size: int) -> Image.Image:
    """Return the picture, shape (h, h), of a larger depth image: near points are bright, the background is white."""
    seen = depth > 0
    low, high = (float(depth[seen].min()), float(depth[seen].max())) if seen.any() else (0.0, 0.0)
    grey = np.where(seen, 0.15 + 0.75 * (depth - low) / max(high - low, 1e-9), 1.0)
    picture = Image.fromarray(np.round(255 * grey).astype(np.uint8)).convert("RGB")
    return picture.resize((size, size), Image.Resampling.BOX)


def save_png(image: Image.Image, path: Path) -> None:
    """Write a PNG without date; raise ``ConfigurationError`` for another extension or if writing fails."""
    if path.suffix.lower() != ".png":
        raise ConfigurationError(f"{path} is not the name of a PNG file", "use the extension .png")
    try:
        write_atomically(path, lambda file: image.save(file, format="PNG", optimize=True))
    except OSError as error:
        raise ConfigurationError(
            f"cannot write {path}: {error.strerror}", "choose another file with -o or --picture"
        ) from error


def as_file(figure: Figure, ending: str) -> bytes:
    """Return a figure as file content for an extension, without dates, so that equal figures give equal files."""
    import matplotlib as mpl

    stream = io.BytesIO()
    settings = {"svg.hashsalt": "figure", "pdf.fonttype": 42}  # publishers refuse the default, Type 3
    with mpl.rc_context(settings), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # replaced by a box
        options: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.03, "metadata": _UNDATED[ending]}
        figure.savefig(stream, format=ending[1:], **options)
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file extension."""
    data = as_file(figure, path.suffix.lower())
    try:
        write_atomically(path, lambda file: file.write(data))
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another folder with -o") from error


def _colours(values: NDArray[np.float64]) -> NDArray[np.float64]:
    places = np.linspace(0, 1, len(_PALETTE))
    return np.stack([np.interp(values, places, channel) for channel in _PALETTE.T], axis=-1)


def _draw_edges(
    rgba: NDArray[np.float64], pixels: Points, faces: NDArray[np.int32], values: NDArray[np.float64] | None
) -> None:
    """Draw the edges below the surface, so that parts thinner than a pixel do not vanish."""
    edges = edges_of(faces).ends
    first, last = np.clip(pixels[edges, :2], -len(rgba), 2 * len(rgba)).swapaxes(0, 1)
    counts = np.ceil(np.abs(last - first).max(axis=1)).astype(np.int64) + 1  # one point per pixel
    edge = np.repeat(np.arange(len(edges)), counts)
    along = (np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)) / np.maximum(counts - 1, 1)[edge]
    places = np.floor(first[edge] + along[:, None] * (last - first)[edge]).astype(np.int64)
    inside = ((places >= 0) & (places < len(rgba))).all(axis=1)
    column, row = places[inside].T
    rgba[row, column, 3] = 1.0
    if values is None:
        rgba[row, column, :3] = _PLAIN
    else:
        start, end = values[edges[edge]].T
        rgba[row, column, :3] = 0.85 * _colours((start + along * (end - start))[inside])


def _surface_colours(
    scaled: Points, depth: NDArray[np.float64], seen: NDArray[np.bool_], values: NDArray[np.float64] | None, fine: int
) -> NDArray[np.float64]:
    if values is None:
        return _PLAIN[None]
    rows, columns = np.nonzero(seen)
    places = np.column_stack([(columns + 0.5) * 2 / fine - 1, 1 - (rows + 0.5) * 2 / fine, -depth[seen]])
    away, nearest = cKDTree(scaled).query(places, k=range(1, min(3, len(scaled)) + 1))
    return _colours(np.average(values[nearest], axis=1, weights=1 / np.maximum(away, 1e-6)))


def _light(depth: NDArray[np.float64], seen: NDArray[np.bool_], pixel: float) -> NDArray[np.float64]:
    """Return the brightness of each pixel of the surface: directional and ambient light, and a dark rim."""
    filled = np.where(seen, depth, np.max(depth, where=seen, initial=-np.inf))
    down, right = np.gradient(filled, pixel)
    normal = np.stack([right[seen], -down[seen], np.ones(int(seen.sum()))], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(0.52 + 0.62 * np.clip(normal @ _LAMP, 0, 1) * (0.55 + 0.45 * normal[:, 2]))

"""Views of a shape from a single depth camera: a depth image, and the open surface behind it.

Rendering and back-projection share one convention. The camera is orthographic. Its frame is
right-handed, with *x* to the right, *y* up and *z* towards the camera, and its origin at the centre
of the shape's bounding box. The image shows the cube ``[-half_width, half_width]^3`` of that frame,
so the near and far planes also lie at ``+-half_width``, and a depth of 0.5 is the centre of every
shape. Nearer is larger, and 0 is background. All images of a data set share one half width and are
therefore comparable pixel by pixel.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.errors import DatasetError, InvalidMesh, UnsupportedShape
from benchmark.geometry.bridging import bridge_components
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.cleaning import compact, connected_components, make_manifold
from benchmark.geometry.mesh import Faces, FloatArray, Mesh, Points
from benchmark.geometry.rasterise import DepthImage, depth_buffer

SIZE = 500
"""Pixels per side of a depth image."""

SAMPLES = 2000
"""Target number of vertices of a back-projected surface, as for a prepared mesh."""

JUMP = 0.05
"""Largest depth difference along an edge of the back-projected surface.

As a fraction of the half width.
"""

FILL = 0.9
"""Fraction of the frame filled by the largest shape of a data set."""

OUTSIZE = 5.0
"""Maximum width of a shape, as a multiple of the median width, for it to affect the common frame.

Wrong units differ by factors of ten or more; children and adults, or a cat and a gorilla, by less
than three. In the widest possible frame, the median shape still spans 90 of the 500 pixels.
"""

FEWEST_PIXELS = 200
"""Minimum number of foreground pixels: a tenth of the target number of samples of the surface."""

#: Tolerance for equal depths in the choice of a diagonal: ten times the rounding error of an image.
_TIE = 1e-6

LARGEST_VIEW_LOSS = 0.5
"""Maximum fraction of the visible surface that a view may lose, so that the larger part remains.

Cutting at depth jumps also removes surface at grazing angles, so even valid shapes lose some: a
sphere that fills the frame 26 %; ordinary data sets far less, see ``docs/data.md``.
"""

SPECK = 8
"""Least number of vertices of a piece.

Smaller pieces are dropped: slivers at grazing silhouettes, not limbs.
"""


@dataclass(frozen=True, eq=False)
class View:
    """A shape seen by a single camera.

    Parameters
    ----------
    depth
        Depth image, shape (size, size).
    surface
        The open surface behind the image, in camera coordinates.
    report
        Counts of :func:`back_project`.
    """

    depth: DepthImage
    surface: Mesh
    report: dict[str, float]


def camera_coordinates(mesh: Mesh, camera: Camera) -> Points:
    """Return the vertices in the camera frame, centred on the bounding box.

    Parameters
    ----------
    mesh
        The shape; needs at least one vertex.
    camera
        The viewing direction.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3): right, up, towards the camera; in units of the mesh.
    """
    points = mesh.vertices @ camera.rotation.T
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return np.asarray(points - centre)


def fit_half_width(mesh: Mesh, camera: Camera) -> float:
    """Return the half width of the frame in which the bounding box of a shape fills :data:`FILL`.

    Depth counts in the same way as width and height, so that no shape reaches the near or far
    plane.

    Parameters
    ----------
    mesh
        The shape; needs at least one vertex.
    camera
        The viewing direction.

    Returns
    -------
    float
        Half width in units of the mesh.

    Raises
    ------
    DatasetError
        If the shape has no extent.
    """
    extent = float(np.abs(camera_coordinates(mesh, camera)).max())
    if extent == 0:
        problem = "the shape has no extent, so no frame fits"
        raise DatasetError(problem, "check that the mesh is not empty")
    return extent / FILL


def common_half_width(half_widths: Sequence[float]) -> float:
    """Return the common half width of a data set: the largest one that is not an outlier.

    Otherwise, a single file in another unit or with a stray vertex would shrink all other shapes to
    a few pixels. A shape is an outlier if it is more than ``OUTSIZE`` times as wide as the median
    one.

    Parameters
    ----------
    half_widths
        Half width, or extent, of each shape; at least one.

    Returns
    -------
    float
        The largest value that is not an outlier, unchanged.
    """
    limit = OUTSIZE * statistics.median_low(half_widths)
    return max(half_width for half_width in half_widths if half_width <= limit)


def render_depth(mesh: Mesh, camera: Camera, half_width: float, size: int = SIZE) -> DepthImage:
    """Render an orthographic depth image of a shape in the centre of the frame.

    Parameters
    ----------
    mesh
        The shape. All vertices count for its centre and extent, also those without triangles.
    camera
        The viewing direction.
    half_width
        Half the side of the frame and of its depth, in units of the mesh.
    size
        Pixels per side.

    Returns
    -------
    numpy.ndarray
        Shape (size, size), float32. On the shape, (far - z) / (far - near), between 0 at the far
        and 1 at the near plane; 0 elsewhere. The centre of pixel (r, c) lies at x = (c + 1/2) step
        - half_width and y = half_width - (r + 1/2) step, where step = 2 half_width / size.

    Raises
    ------
    UnsupportedShape
        If the shape has no faces, or does not fit the frame.
    """
    if mesh.n_faces == 0:
        problem = "a mesh without faces casts no depth image"
        raise UnsupportedShape(problem, "pass a surface, not a point cloud")
    points = camera_coordinates(mesh, camera) / half_width
    extent = float(np.abs(points).max())
    if not extent < 1:
        problem = (
            f"the shape extends to {extent:.4g} of the half width {half_width:g} "
            "of the camera's frame"
        )
        hint = (
            "check its unit and look for stray vertices, or give the data set a half width "
            f"of at least {extent * half_width / FILL:.6g}"
        )
        raise UnsupportedShape(problem, hint)
    x, y, z = points.T
    pixels = np.stack([(1 + x) * (size / 2), (1 - y) * (size / 2), -z], axis=1)
    # The background lies on the far plane, so the same formula gives it depth 0.
    distance = depth_buffer(pixels, mesh.faces, size, 1.0)
    return np.asarray((1 - distance) / 2, dtype=np.float32)


def back_project(
    depth: DepthImage, half_width: float, stride: int | None = None, jump: float = JUMP
) -> tuple[Mesh, dict[str, float]]:
    """Convert a depth image to the visible surface, as a connected manifold with boundary.

    Every ``stride``-th pixel becomes a vertex. Each square of four samples becomes two triangles,
    or one if a sample is background. Triangles across a jump of depth are left out, because they
    would join an arm to the chest behind it. Separate pieces are joined by bridges, so that no limb
    is lost.

    Parameters
    ----------
    depth
        Depth image, shape (size, size), in [0, 1] with 0 as background; see :func:`render_depth`.
    half_width
        Half width used to render the image.
    stride
        Pixels between samples, the first at ``stride // 2``; None for about 2000 samples, whatever
        the size of the shape in the frame.
    jump
        Maximum depth difference along an edge, as a fraction of the half width.

    Returns
    -------
    mesh : Mesh
        Open surface in camera coordinates and units of ``half_width``; the triangles face the
        camera.
    report : dict of str to float
        - ``foreground``: number of pixels that show the shape;
        - ``stride``: pixels between samples;
        - ``pieces``, ``bridges``: number of connected pieces, and of bridges between them;
        - ``specks``: number of pieces that were dropped, with fewer than ``SPECK`` vertices;
        - ``lost_samples``, ``lost_area``: number of samples of the shape that are missing from the
          surface, and their share.

    Raises
    ------
    InvalidMesh
        If the image is not square, or a pixel is not a number in [0, 1].
    UnsupportedShape
        If the image is empty, or has too few samples for a surface.
    """
    foreground = _count_foreground(depth)
    if stride is None:
        stride = max(1, round(math.sqrt(foreground / SAMPLES)))
    samples, points = _sampled(depth, stride)
    mesh, pieces, specks = _without_specks(points, _triangulate(samples, jump / 2))
    if mesh.n_faces == 0:
        problem = f"{foreground} pixels of foreground hold no piece of {SPECK} samples"
        hint = "check the half width of the data set or sample with a smaller stride"
        raise UnsupportedShape(problem, hint)
    # Samples that are in no piece. Where pieces touch, a sample has several vertices, counted once.
    sampled = int(np.count_nonzero(samples))
    lost = sampled - len(np.unique(mesh.vertices[:, :2], axis=0))
    mesh, gaps = bridge_components(mesh.with_vertices(mesh.vertices * half_width))
    return mesh, {
        "foreground": foreground,
        "stride": stride,
        "pieces": pieces,
        "bridges": len(gaps),
        "specks": specks,
        "lost_samples": lost,
        "lost_area": round(lost / sampled, 6),
    }


def _count_foreground(depth: DepthImage) -> int:
    """Return the number of pixels of a depth image that show the shape.

    Parameters
    ----------
    depth
        Depth image, shape (size, size), with 0 as background.

    Raises
    ------
    InvalidMesh
        If the image is not square, or a pixel is not a number in [0, 1].
    UnsupportedShape
        If no pixel shows the shape.
    """
    is_square = depth.ndim == 2 and depth.shape[0] == depth.shape[1]
    if not is_square or not ((depth >= 0) & (depth <= 1)).all():
        problem = (
            f"a depth image of shape {depth.shape} is not square, or holds values outside [0, 1]"
        )
        raise InvalidMesh(problem, "normalise it as `render_depth` does, with 0 outside")
    foreground = int(np.count_nonzero(depth))
    if foreground == 0:
        problem = "the depth image is empty"
        raise UnsupportedShape(problem, "check the camera and the half width of the data set")
    return foreground


def _sampled(depth: DepthImage, stride: int) -> tuple[FloatArray, Points]:
    """Sample every few pixels of a square depth image.

    Parameters
    ----------
    depth
        Depth image, shape (size, size), in [0, 1] with 0 as background.
    stride
        Pixels between samples, the first at ``stride // 2``.

    Returns
    -------
    samples : numpy.ndarray
        Values of the sampled pixels, shape (rows, columns).
    points : numpy.ndarray
        Their positions in the frame [-1, 1]^3, row by row, shape (rows * columns, 3): the centres
        of the pixels, and their depths.
    """
    first = stride // 2
    samples = depth[first::stride, first::stride].astype(np.float64)
    centres = (np.arange(len(samples)) * stride + first + 0.5) * (2 / depth.shape[0]) - 1
    x, y = np.meshgrid(centres, -centres)
    points = np.stack([x, y, 2 * samples - 1], axis=-1).reshape(-1, 3)
    return samples, points


def depth_surface(
    mesh: Mesh, camera: Camera, half_width: float, sensor: DepthSensor | None = None
) -> View:
    """Return what a camera sees of a shape: its depth image, and the surface made from it.

    It combines :func:`render_depth` and :func:`back_project`.

    Parameters
    ----------
    mesh
        The shape.
    camera
        The viewing direction.
    half_width
        Half the side of the camera's frame, in units of the mesh.
    sensor
        Noise and quantisation of the image; None for an ideal camera.

    Raises
    ------
    UnsupportedShape
        If fewer than ``FEWEST_PIXELS`` pixels show the shape, or more than ``LARGEST_VIEW_LOSS`` of
        its samples are lost.
    """
    depth = render_depth(mesh, camera, half_width)
    if sensor is not None:
        depth = sensor.perturbed(depth)
    foreground = int(np.count_nonzero(depth))
    if foreground < FEWEST_PIXELS:
        problem = f"the camera sees {foreground} pixels of the shape, fewer than {FEWEST_PIXELS}"
        raise UnsupportedShape(problem, "check its unit against the other shapes of the data set")
    surface, report = back_project(depth, half_width)
    if report["lost_area"] > LARGEST_VIEW_LOSS:
        problem = (
            f"{report['lost_area']:.0%} of what the camera sees belongs to no piece "
            f"of {SPECK} samples"
        )
        hint = (
            "join what belongs together, remove what does not, "
            "or set a camera that sees it from another side"
        )
        raise UnsupportedShape(problem, hint)
    return View(depth, surface, report)


def _triangulate(samples: Points, jump: float) -> Faces:
    """Triangulate a grid of depths, without triangles across a jump of depth.

    Each square of four samples becomes two triangles. It is divided along the diagonal whose ends
    differ less in depth. If one sample is background, the other three become one triangle.

    Parameters
    ----------
    samples
        Depth of each sample, shape (rows, columns); larger is nearer, 0 is background.
    jump
        Largest difference of depth within a triangle.

    Returns
    -------
    numpy.ndarray
        Indices into the flat grid, shape (m, 3); triangles face the camera.
    """
    index = np.arange(samples.size, dtype=np.int32).reshape(samples.shape)
    # Corners of each block, counter-clockwise in the image.
    a = index[:-1, :-1].ravel()  # top left
    b = index[1:, :-1].ravel()  # bottom left
    c = index[1:, 1:].ravel()  # bottom right
    d = index[:-1, 1:].ravel()  # top right
    z = samples.ravel()
    seen = z > 0
    # A diagonal that ends in the background is not taken. If one corner is background, the other
    # diagonal then leaves the triangle of the three other corners.
    along_ac = np.where(seen[a] & seen[c], np.abs(z[a] - z[c]), np.inf)
    along_bd = np.where(seen[b] & seen[d], np.abs(z[b] - z[d]), np.inf)
    split_ac = (along_ac <= along_bd + _TIE)[:, np.newaxis]
    first = np.where(split_ac, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(split_ac, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    # Interleave them, so that both triangles of a square stand one after the other.
    faces = np.stack([first, second], axis=1).reshape(-1, 3)
    corners = z[faces]
    whole = seen[faces].all(axis=1) & (corners.max(axis=1) - corners.min(axis=1) <= jump)
    return np.asarray(faces[whole], dtype=np.int32)


def _without_specks(points: Points, faces: Faces) -> tuple[Mesh, int, int]:
    """Return the mesh without stray samples and small pieces.

    With it come the numbers of pieces kept and dropped.
    """
    # Patches that touch in a single sample are separate: a surface pinched to a point is not a
    # manifold.
    surface = make_manifold(compact(points, faces))
    labels = connected_components(surface)
    large = np.bincount(labels) >= SPECK
    mesh = compact(surface.vertices, surface.faces[large[labels[surface.faces[:, 0]]]])
    return mesh, int(large.sum()), int((~large).sum())

"""Deformation field: the canonical position of each vertex, with the detail of the input.

A surface is seen in the frame of its principal axes, and sampled evenly. Positions and rotations
that the network (:mod:`learned.field_network`) predicts attract a deformation that is as rigid as
possible.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu
from torch import Tensor

from benchmark.api.contracts import FloatArray, Shape
from benchmark.errors import UnsupportedShape
from benchmark.geometry.laplacian import Laplacian
from benchmark.geometry.mesh import Mesh, Points, vertex_normals
from learned.field_network import N_POINTS, FieldNetwork

MOST_VERTICES = 50_000
"""Largest number of vertices; meshes prepared for a comparison have 2000."""

INSIDE_OUT = 1e-9
"""Size of a negative volume above which a surface faces inward, in units of sqrt(area)^3.

A flat one has no volume.
"""

FLAT = 1e-9
"""Share of the variance below which a surface has no extent along an axis."""

#: Positions that are decoded together, which bounds the memory for large meshes.
_AT_ONCE = 4096


def form_of(
    network: FieldNetwork, shape: Shape, reach: float, rounds: int
) -> tuple[Points, dict[str, float | str]]:
    """Predict the canonical form of a surface, with the details of the input.

    Parameters
    ----------
    network
        The deformation field.
    shape
        The input.
    reach
        Size of the details that come from the input, see :func:`with_detail`.
    rounds
        Rounds of fitting these details.

    Returns
    -------
    vertices : numpy.ndarray
        Vertices of the form, of unit area, shape (n, 3).
    notes : dict
        ``edge_strain`` is the sum of the changes of all edge lengths over the sum of the lengths.
        ``mean_correction`` is the mean distance of the vertices from the predicted positions. Both
        compare surfaces of unit area.

    Raises
    ------
    UnsupportedShape
        If the surface has no area or too many vertices, or its form has no area.
    """
    mesh = shape.mesh
    if mesh.n_vertices > MOST_VERTICES:
        problem = f"a deformation field of {mesh.n_vertices} vertices takes too long"
        raise UnsupportedShape(problem, f"keep at most {MOST_VERTICES}")
    framed = in_frame(mesh)
    positions, rotations = predicted(network, _outward(framed))
    detailed = with_detail(
        framed.vertices, shape.laplacian(), positions, rotations, reach=reach, rounds=rounds
    )
    form = _of_unit_area(mesh, detailed)
    change_of_lengths = np.abs(form.edge_lengths - framed.edge_lengths)
    corrections = np.linalg.norm(form.vertices - positions, axis=1)
    notes: dict[str, float | str] = {
        "edge_strain": float(change_of_lengths.sum() / framed.edge_lengths.sum()),
        "mean_correction": float(corrections.mean()),
    }
    return form.vertices, notes


def _of_unit_area(mesh: Mesh, vertices: Points) -> Mesh:
    """Return a mesh with other vertices, which are scaled until its area is one.

    Raises
    ------
    UnsupportedShape
        If the vertices are not finite or leave no area, because the network failed.
    """
    is_finite = bool(np.isfinite(vertices).all())
    area = mesh.with_vertices(vertices).area if is_finite else 0.0
    if not area > 0:
        problem = "the network leaves no surface of this shape"
        raise UnsupportedShape(problem, "pass one like those it was trained on")
    return mesh.with_vertices(vertices / area**0.5)


@torch.inference_mode()
def predicted(network: FieldNetwork, mesh: Mesh) -> tuple[Points, FloatArray]:
    """Predict the canonical position of each vertex, and the rotation of the surface around it.

    Parameters
    ----------
    network
        The deformation field.
    mesh
        A surface in its own frame, see :func:`in_frame`.

    Returns
    -------
    positions : numpy.ndarray
        Shape (n, 3), in units of the root of the area.
    rotations : numpy.ndarray
        Rotation matrices, shape (n, 3, 3).
    """
    # The network encodes points that are spread over the surface, and decodes each vertex.
    samples, normals_of_samples = even_samples(mesh, N_POINTS)
    tokens = network.encoded(_batch_of_one(samples), _batch_of_one(normals_of_samples))
    normals = vertex_normals(mesh)
    positions = []
    rotations = []
    for first in range(0, mesh.n_vertices, _AT_ONCE):
        block = slice(first, first + _AT_ONCE)
        position, rotation = network.decoded(
            tokens, _batch_of_one(mesh.vertices[block]), _batch_of_one(normals[block])
        )
        positions.append(position[0].numpy())
        rotations.append(rotation[0].numpy())
    return np.concatenate(positions), np.concatenate(rotations)


def _batch_of_one(array: FloatArray) -> Tensor:
    """Return an array as a batch of one item."""
    return torch.from_numpy(np.array(array, dtype=np.float64))[None]


def _outward(mesh: Mesh) -> Mesh:
    """Return the surface with its triangles flipped if its volume is negative.

    Bodies face outward.
    """
    a, b, c = _corners(mesh)
    volume = float(np.einsum("mk,mk->", a, np.cross(b, c)) / 6)
    return Mesh(mesh.vertices, mesh.faces[:, ::-1]) if volume < -INSIDE_OUT else mesh


def _corners(mesh: Mesh) -> tuple[Points, Points, Points]:
    """Return the positions of the first, second and third corner of each triangle."""
    first, second, third = mesh.faces.T
    return mesh.vertices[first], mesh.vertices[second], mesh.vertices[third]


# Frame
# ------------------------------------------------------------------------------------------------


def in_frame(mesh: Mesh) -> Mesh:
    """Return a surface in the frame of its principal axes, with unit area and its centroid at 0.

    The longest axis comes first. The two axes along which the surface is most skewed point towards
    its longer tail; the third axis makes the frame right-handed. Moments are integrals over the
    triangles, so that the frame does not depend on the triangulation.

    Parameters
    ----------
    mesh
        A triangle mesh.

    Raises
    ------
    UnsupportedShape
        If the area is zero, or infinite because the coordinates are too large.
    """
    areas = mesh.face_areas
    total = float(areas.sum())
    if not np.isfinite(total):
        raise UnsupportedShape("the coordinates are too large to compute with", "scale the mesh")
    if not total > 0:
        problem = "the mesh has no area"
        raise UnsupportedShape(problem, "pass a surface with at least one proper triangle")
    shares = areas / total
    # Corners of the triangles, from the centroid of the surface, in units of the root of its area.
    a, b, c = _corners(mesh)
    origin = shares @ (a + b + c) / 3
    unit = total**0.5
    axes = _principal_axes([(corner - origin) / unit for corner in (a, b, c)], shares)
    return mesh.with_vertices((mesh.vertices - origin) @ axes.T / unit)


def _principal_axes(corners: list[Points], shares: FloatArray) -> FloatArray:
    """Return the principal axes of a surface as rows of a rotation matrix, longest first.

    Parameters
    ----------
    corners
        First, second and third corners of the triangles, each of shape (m, 3); the centroid of the
        surface is at 0.
    shares
        Area of each triangle as a share of the whole area, shape (m,).
    """
    # The second moment of a triangle with the corners a, b, c, over its area, is the twelfth part
    # of a a^T + b b^T + c c^T + s s^T, with s = a + b + c.
    moments = [(shares[:, None] * points).T @ points for points in (*corners, sum(corners))]
    covariance = sum(moments) / 12
    _, vectors = np.linalg.eigh(covariance)  # ascending
    axes = vectors.T[::-1].copy()
    # The sign of an axis is arbitrary. It is chosen so that the skewness is positive; if that makes
    # the frame left-handed, the axis with the least skewness is reversed.
    skewness = _skewness([corner @ axes.T for corner in corners], shares)
    axes[skewness < 0] *= -1
    if np.linalg.det(axes) < 0:
        axes[np.abs(skewness).argmin()] *= -1
    return axes


def _skewness(corners: list[Points], shares: FloatArray) -> FloatArray:
    """Return the third standardised moment along each axis, shape (3,), of triangles.

    The mean of t^3 over a triangle is a tenth of the complete homogeneous polynomial of its
    corners.

    Parameters
    ----------
    corners
        First, second and third corners.
    shares
        Shares of the triangles of the area.
    """
    a, b, c = corners
    first = a + b + c
    second = a * a + b * b + c * c
    third = a * a * a + b * b * b + c * c * c
    homogeneous = (first * (first * first + 3 * second) + 2 * third) / 6
    variance = shares @ (first * first + second) / 12
    # Along the normal of a flat surface there are only rounding errors.
    least = np.maximum(variance, FLAT * variance.sum())
    return np.asarray(shares @ homogeneous / 10 / least**1.5)


# Samples
# ------------------------------------------------------------------------------------------------

PER_POINT = 4
"""Candidates per sampled point."""

MOST_PER_TRIANGLE = 64
"""Largest number of candidates along the side of a triangle, that of one with the whole area."""

TIE = 1e-6
"""Relative difference below which squared distances are equal, far above rounding errors."""

#: Direction perpendicular to no edge of a regular shape; the component along it breaks ties between
#: distances.
_TIE_BREAKER = np.array([1.0, 0.7390851332, 0.5671432904])


def even_samples(mesh: Mesh, count: int) -> tuple[Points, Points]:
    """Sample a surface by farthest point sampling.

    The samples do not depend on the order of vertices and triangles. Each triangle gets candidates
    according to its area, at the centres of the small triangles into which it is divided. These do
    not depend on the order of its corners.

    Parameters
    ----------
    mesh
        A surface with area, in its own frame.
    count
        Number of points, m.

    Returns
    -------
    points, normals : numpy.ndarray
        Points and the unit normals of their triangles, shape (m, 3); the first few are spread as
        evenly as all.
    """
    candidates, face_of_candidate = _candidates(mesh, PER_POINT * count)
    chosen = _farthest_points(candidates, candidates @ _TIE_BREAKER, count)
    normals = mesh.face_normals[face_of_candidate[chosen]]
    lengths = np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-300)
    return candidates[chosen], normals / lengths


def _candidates(mesh: Mesh, count: int) -> tuple[Points, NDArray[np.int64]]:
    """Spread points over a surface, at the centres of equal parts of its triangles.

    Each triangle is divided into k^2 small ones, so that all parts have nearly the same area.

    Parameters
    ----------
    mesh
        A surface with area.
    count
        Approximate number of points; there are more if many triangles are small.

    Returns
    -------
    points : numpy.ndarray
        Shape (c, 3).
    faces : numpy.ndarray
        The triangle on which each of them lies, shape (c,).
    """
    areas = mesh.face_areas
    # k^2 is about the share of a triangle in all points. The small margin gives triangles of equal
    # area the same k, however their areas are rounded; triangles without area get no points.
    n_parts = areas / areas.sum() * count
    k_of_face = np.ceil(np.sqrt(n_parts) * (1 - TIE)).astype(np.int64)
    k_of_face = np.where(areas > 0, np.clip(k_of_face, 1, MOST_PER_TRIANGLE), 0)
    points = []
    faces = []
    for k in np.unique(k_of_face[k_of_face > 0]):
        divided = np.flatnonzero(k_of_face == k)
        weights = _centres(int(k))
        centres = np.einsum("wc,mcx->mwx", weights, mesh.vertices[mesh.faces[divided]])
        points.append(centres.reshape(-1, 3))
        faces.append(np.repeat(divided, len(weights)))
    return np.concatenate(points), np.concatenate(faces)


def _centres(k: int) -> FloatArray:
    """Return the barycentric coordinates of the centres of the k^2 parts of a triangle.

    The shape is (k^2, 3).
    """
    rows, columns = np.indices((k, k))
    i = rows.ravel()
    j = columns.ravel()
    upright = i + j < k
    inverted = i + j < k - 1
    first = np.concatenate([i[upright] + 1 / 3, i[inverted] + 2 / 3])
    second = np.concatenate([j[upright] + 1 / 3, j[inverted] + 2 / 3])
    return np.stack([first, second, k - first - second], axis=1) / k


def _farthest_points(points: FloatArray, keys: FloatArray, count: int) -> NDArray[np.int64]:
    """Select points by farthest point sampling, starting farthest from the origin.

    The larger key breaks ties. If there are fewer points than requested, points repeat.
    """
    chosen = np.zeros(count, dtype=np.int64)
    squares = _squares_from(points, np.zeros(3))
    for number in range(count):
        tied = np.flatnonzero(squares >= squares.max() * (1.0 - TIE))
        chosen[number] = tied[keys[tied].argmax()]
        from_chosen = _squares_from(points, points[chosen[number]])
        squares = np.minimum(squares, from_chosen) if number else from_chosen
    return chosen


def _squares_from(points: FloatArray, place: FloatArray) -> FloatArray:
    """Return the squared distances of points from a place."""
    x, y, z = (points - place).T
    return np.asarray(x * x + y * y + z * z)


# Detail
# ------------------------------------------------------------------------------------------------

LEAST_WEIGHT = 1e-2
"""Smallest edge weight, as a share of the mean weight.

Cotangents of obtuse pairs are negative or zero.
"""

INERTIA = 1e-3
"""Weight of the previous rotation of a cell, as a share of the weight of its edges.

A cell whose edges do not determine its rotation keeps the previous one.
"""


def with_detail(
    rest: Points,
    laplacian: Laplacian,
    positions: Points,
    rotations: FloatArray,
    *,
    reach: float,
    rounds: int,
) -> Points:
    r"""Deform a surface towards predicted positions, and keep its details.

    Minimise

    .. math::
        \frac12 \sum_{ij} w_{ij} \|(x_i - x_j) - R_i (p_i - p_j)\|^2
        + \rho^{-2} \sum_i m_i \|x_i - y_i\|^2

    over the positions :math:`x` for the predicted rotations :math:`R`, and then alternately over
    rotations and positions: as-rigid-as-possible deformation [Sorkine & Alexa 2007, equations 3 and
    8] with a term that attracts it to the predicted positions :math:`y`. Details smaller than
    :math:`\rho` come from the input :math:`p`, the positions of larger parts from the prediction.
    With the weights w of edges (i, j) and the shares m of vertices in the area, the best positions
    for given rotations solve, for each vertex i,

    .. math::
        \sum_j w_{ij} (x_i - x_j) + \rho^{-2} m_i x_i
        = \sum_j w_{ij} \tfrac12 (R_i + R_j) (p_i - p_j) + \rho^{-2} m_i y_i .

    Parameters
    ----------
    rest
        Vertices of the input, of unit area, shape (n, 3).
    laplacian
        Its Laplacian, at any size and position.
    positions
        Predicted positions, shape (n, 3).
    rotations
        Predicted rotations, shape (n, 3, 3).
    reach
        Length :math:`\rho`, in units of sqrt(area); 0 returns the predicted positions.
    rounds
        Rounds of fitting rotations, and then positions, after the first positions.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    if reach == 0:
        return positions
    weights = _edge_weights(laplacian)
    attraction = laplacian.mass / laplacian.mass.sum() / reach**2
    matrix = csc_array(diags_array(weights.sum(axis=1) + attraction) - weights)
    # The matrix is the same in all rounds, so it is factorised once. It is symmetric: these options
    # of SuperLU keep the diagonal as pivots.
    factors = splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    cells = _Cells(rest, weights)
    attracted = attraction[:, None] * positions
    refined = factors.solve(cells.load(rotations) + attracted)
    for _ in range(rounds):
        rotations = cells.rotations(refined, rotations)
        refined = factors.solve(cells.load(rotations) + attracted)
    return np.asarray(refined)


def _edge_weights(laplacian: Laplacian) -> csr_array:
    """Return the weights of edges, none of which is negative or much below the mean."""
    weights = csr_array(-laplacian.stiffness)
    weights.setdiag(0)
    weights.eliminate_zeros()
    weights.sort_indices()
    # First without negative ones, so that these do not lower the mean.
    weights.data = np.maximum(weights.data, 0.0)
    weights.data = np.maximum(weights.data, LEAST_WEIGHT * weights.data.mean())
    return weights


class _Cells:
    """Edges around each vertex.

    ``starts`` and ``ends`` are the vertices of each directed edge, shape (e,), ``edges`` the
    vectors from end to start, shape (e, 3). ``sums`` adds values of edges over their starts, shape
    (n, e).
    """

    def __init__(self, rest: Points, graph: csr_array) -> None:
        self.starts = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
        self.ends = graph.indices
        self.weights = graph.data
        self.edges = rest[self.starts] - rest[self.ends]
        n_edges = len(self.starts)
        entries = (np.ones(n_edges), np.arange(n_edges), graph.indptr)
        self.sums = csr_array(entries, shape=(graph.shape[0], n_edges))

    def load(self, rotations: FloatArray) -> FloatArray:
        """Return the right-hand side for rotations, shape (n, 3)."""
        between = 0.5 * (rotations[self.starts] + rotations[self.ends])
        turned = np.einsum("eij,ej->ei", between, self.edges)
        return np.asarray(self.sums @ (self.weights[:, None] * turned))

    def rotations(self, positions: Points, before: FloatArray) -> FloatArray:
        """Return the best-fitting rotations of the cells, shape (n, 3, 3); see :data:`INERTIA`."""
        edges = positions[self.starts] - positions[self.ends]
        products = self.weights[:, None, None] * edges[:, :, None] * self.edges[:, None, :]
        size = self.sums @ (self.weights * (self.edges**2).sum(axis=1))
        size = np.maximum(size, np.finfo(float).tiny)
        sums = (self.sums @ products.reshape(-1, 9)).reshape(-1, 3, 3)
        left, _, right = np.linalg.svd(sums / size[:, None, None] + INERTIA * before)
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        return np.asarray(left @ right)

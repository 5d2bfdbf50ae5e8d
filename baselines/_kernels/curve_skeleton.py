"""Curve skeletons: joints, bones between them, and the part of the surface of each joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import shortest_path

from baselines._kernels.arap import factorise_definite
from baselines._kernels.connectivity_surgery import collapse
from benchmark.api.contracts import FloatArray
from benchmark.geometry.cleaning import component_labels, weighted_means
from benchmark.geometry.laplacian import cotangent_laplacian
from benchmark.geometry.mesh import IntArray, Mesh

CENTREDNESS_GAIN = 0.9
"""A junction moves onto a neighbour if that lowers the spread of its distances to the surface below
this multiple.
"""

SPECK_SHARE = 0.002
"""Pieces of a band below this share of the area are ripples of the band's border, not limbs."""

EDGES_PER_BAND = 2.0
"""Minimum width of a band, in mean edge lengths."""

RADIUS = 100.0
"""Radius of the surface during the contraction; the schedule of the weights assumes this unit of
length.
"""

FIRST_CONTRACTION = 1e-3
"""Initial contraction weight over the square root of the mean face area."""

CONTRACTION_GROWTH = 3.0
"""Factor by which the contraction weight grows with each iteration."""
LARGEST_CONTRACTION = 2048.0
"""Bound of the contraction weight."""
LARGEST_ATTRACTION = 10_000.0
"""Bound of the attraction weight of a vertex."""
MAX_ITERATIONS = 20
"""Most iterations of the contraction."""

AREA_RATIO = 0.01
"""Share of the area at which the contraction ends."""

LARGEST_SHARE_LEFT = 10 * AREA_RATIO
"""Share of the area above which a surface has not contracted to a skeleton."""

LARGEST_COORDINATE = 10 * RADIUS
"""Coordinate beyond which the contraction has diverged."""


@dataclass(frozen=True, eq=False)
class CurveSkeleton:
    """Joints inside a surface, and the vertices that each owns.

    Parameters
    ----------
    joints
        Positions, shape (k, 3), in units of the surface.
    owners
        Joint of each vertex of the surface, shape (n,); the vertices of one joint are connected.
    bones
        Pairs of joints whose parts share an edge of the surface, shape (b, 2), smaller index first,
        sorted.
    """

    joints: FloatArray
    owners: IntArray
    bones: IntArray

    def path_lengths(self) -> FloatArray:
        """Return the lengths of the shortest paths along the bones between joints, shape (k, k)."""
        first, second = self.joints[self.bones.T]
        # A stored zero would mean "no bone".
        lengths = np.maximum(np.linalg.norm(first - second, axis=1), np.finfo(float).tiny)
        graph = csr_array((lengths, self.bones.T), shape=(len(self.joints), len(self.joints)))
        return np.asarray(shortest_path(graph, directed=False))


def contraction_skeleton(mesh: Mesh) -> CurveSkeleton:
    """Contract a closed surface to a centred curve skeleton (Au et al. 2008, sections 4 to 6).

    Connectivity surgery gives the joints. Each moves back by the mean displacement, under the
    contraction, of the border between its part and that of a neighbour, weighted by the lengths of
    the border's edges and averaged over the neighbours; a leaf, by the mean over its whole part.
    Junctions then move onto the neighbour from which the distances to both parts spread least, as
    long as these spread less than those of the junction to its own part.

    A pocket, such as an open mouth, forms a branch like a limb, and straightening it would turn it
    inside out. The neighbours of leaves whose part of the surface faces its joint therefore absorb
    them.

    Parameters
    ----------
    mesh
        A closed, connected surface.

    Raises
    ------
    ContractionFailed
        If the surface degenerates while more than a tenth of its area is left.
    """
    contracted = contract(mesh)
    survivors, owners = np.unique(collapse(mesh.with_vertices(contracted)), return_inverse=True)
    joints = contracted[survivors] + _mean_displacements(mesh, mesh.vertices - contracted, owners)
    joints, owners = _merge_junctions(mesh, joints, owners)
    joints, owners = _absorb_pockets(mesh, joints, owners)
    return CurveSkeleton(joints, owners, _bones(mesh, owners))


class ContractionFailed(Exception):
    """Failure of a contraction: the surface became non-finite or degenerate before it was thin."""


def contract(mesh: Mesh) -> FloatArray:
    r"""Contract a closed surface to almost no volume by smoothing (Au et al. 2008, equation 1).

    Each iteration solves, in the least-squares sense,

    .. math:: \begin{bmatrix} W_L L \\ W_H \end{bmatrix} V'
              = \begin{bmatrix} 0 \\ W_H V \end{bmatrix}

    with the cotangent Laplacian :math:`L` of the current surface. The contraction weight
    :math:`W_L` triples in each iteration. The attraction weight :math:`W_H` of a vertex is the root
    of the ratio by which its area has shrunk, so that parts that are already thin stay in place.
    Weights, caps and stopping criterion are those of Pickup et al. (2016).

    Parameters
    ----------
    mesh
        Closed, connected surface.

    Returns
    -------
    numpy.ndarray
        Contracted vertices, shape (n, 3), in units of the mesh.

    Raises
    ------
    ContractionFailed
        If the surface degenerates while more than a tenth of its area is left.
    """
    # The weights are made for a surface of this radius.
    centre = mesh.vertices.mean(axis=0)
    unit = np.linalg.norm(mesh.vertices - centre, axis=1).max() / RADIUS
    current = mesh.with_vertices((mesh.vertices - centre) / unit)
    first_areas = current.vertex_areas
    contraction = FIRST_CONTRACTION * np.sqrt(current.face_areas.mean())
    attraction = np.ones(current.n_vertices)
    for _ in range(MAX_ITERATIONS):
        if current.area <= AREA_RATIO * first_areas.sum():
            break
        try:
            positions = _contraction_step(current, contraction, attraction)
        except RuntimeError:  # the system lost its definiteness to rounding
            break
        if not np.isfinite(positions).all() or np.abs(positions).max() > LARGEST_COORDINATE:
            break
        candidate = current.with_vertices(positions)
        areas = candidate.vertex_areas
        # A vertex around which no area is left cannot be smoothed further, and a growing area means
        # that the contraction has failed: the previous surface is the result.
        if areas.min() <= 0.0 or candidate.area > current.area:
            break
        current = candidate
        contraction = min(CONTRACTION_GROWTH * contraction, LARGEST_CONTRACTION)
        attraction = np.minimum(np.sqrt(first_areas / areas), LARGEST_ATTRACTION)
    share_left = current.area / first_areas.sum()
    if share_left > LARGEST_SHARE_LEFT:
        raise ContractionFailed(f"{share_left:.0%} of the area is left")
    return np.asarray(current.vertices * unit + centre)


def _contraction_step(mesh: Mesh, contraction: float, attraction: FloatArray) -> FloatArray:
    """Return the vertices after a step of contraction, shape (n, 3)."""
    laplacian = cotangent_laplacian(mesh).stiffness
    squared: FloatArray = attraction**2
    normal_matrix = csr_array(contraction**2 * (laplacian @ laplacian) + diags_array(squared))
    return factorise_definite(normal_matrix)(squared[:, None] * mesh.vertices)


def level_set_skeleton(mesh: Mesh, levels: FloatArray, bands: int) -> CurveSkeleton:
    """Cut a surface into bands between level sets, with a joint in each connected piece.

    This is the skeleton of Verroust & Lazarus (2000) with a fixed number of levels; it handles open
    surfaces, whose borders a contraction would pull in.

    Parameters
    ----------
    mesh
        A connected surface.
    levels
        Geodesic distances from one vertex, shape (n,).
    bands
        Number of bands of equal width between the smallest and the largest level; fewer if a band
        would be narrower than ``EDGES_PER_BAND`` mean edge lengths, since such a band falls apart.
    """
    areas = mesh.vertex_areas
    edges = mesh.edges.ends
    span = levels.max() - levels.min()
    bands = max(2, min(bands, int(span / (EDGES_PER_BAND * mesh.edge_lengths.mean()))))
    band = np.minimum((bands * (levels - levels.min()) / span).astype(np.int64), bands - 1)
    tails, heads = edges[band[edges[:, 0]] == band[edges[:, 1]]].T
    owners = component_labels(tails, heads, mesh.n_vertices)
    owners = _absorb_specks(owners, edges, areas)
    return CurveSkeleton(weighted_means(mesh.vertices, areas, owners), owners, _bones(mesh, owners))


def _bones(mesh: Mesh, owners: IntArray) -> IntArray:
    """Return the pairs of parts that share an edge, shape (b, 2), smaller number first, sorted."""
    pairs = np.sort(owners[mesh.edges.ends], axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _mean_displacements(mesh: Mesh, displacements: FloatArray, owners: IntArray) -> FloatArray:
    """Return how far the contraction moved each joint off the middle of its part of the surface.

    A part between others, such as a piece of an arm, borders on each of them in a loop of vertices.
    Its displacement is the mean along each loop, averaged over its loops. A part with one loop is
    an end, such as a hand: its displacement is the mean over its vertices.

    Parameters
    ----------
    mesh
        The surface before the contraction.
    displacements
        How far the contraction moved each vertex, shape (n, 3), in units of the mesh.
    owners
        Joint of each vertex, shape (n,); the vertices of a joint are its part.

    Returns
    -------
    numpy.ndarray
        Shape (joints, 3); 0 for a part between others that touches one of them in a single vertex.
    """
    n_parts = int(owners.max()) + 1
    lengths = mesh.edge_graph()
    first, second = lengths.tocoo().coords
    goes_across = owners[first] != owners[second]
    # A sparse matrix with a row for each vertex, and a column for each pair of parts: its entries
    # are the loop of vertices of the first part that have an edge to the second one. A vertex
    # counts by the length of its edges to others of the loop.
    loops = csr_array(
        (goes_across, (first, owners[first] * n_parts + owners[second])),
        shape=(mesh.n_vertices, n_parts * n_parts),
        dtype=bool,
    )
    loops.eliminate_zeros()
    weights = loops.multiply(lengths @ loops)
    with np.errstate(invalid="ignore"):  # a loop of one vertex has no edges
        loop_means = (weights.T @ displacements) / weights.sum(axis=0)[:, None]

    # Mean over the loops of each part; over all its vertices, if it has only one loop.
    are_adjacent = (loops.sum(axis=0) > 0).reshape(n_parts, n_parts, 1)
    n_loops = are_adjacent.sum(axis=1)
    sums = np.where(are_adjacent, loop_means.reshape(n_parts, n_parts, 3), 0.0).sum(axis=1)
    means_of_loops = sums / np.maximum(n_loops, 1)
    means_of_vertices = weighted_means(displacements, np.ones(len(owners)), owners)
    return np.nan_to_num(np.where(n_loops > 1, means_of_loops, means_of_vertices))


def _merge_junctions(
    mesh: Mesh, joints: FloatArray, owners: IntArray
) -> tuple[FloatArray, IntArray]:
    """Merge each junction of a skeleton with a neighbour that lies more centrally in the surface.

    A junction is a joint with at least three bones. It is central if its part of the surface is
    everywhere about equally far. It merges with the neighbour that would be the most central joint
    of the parts of both, if that is more central than the junction is; then the merged joint is
    tried again.

    Parameters
    ----------
    mesh
        The surface.
    joints
        Positions, shape (k, 3).
    owners
        Joint of each vertex of the surface, shape (n,).

    Returns
    -------
    joints : numpy.ndarray
        Positions of the joints that are left, shape (l, 3).
    owners : numpy.ndarray
        Joint of each vertex among these, shape (n,).
    """
    has_merged = True
    while has_merged:
        has_merged = False
        n_bones = np.bincount(_bones(mesh, owners).ravel())
        for junction in np.flatnonzero(n_bones > 2).tolist():
            joint = junction
            neighbour = _better_joint(mesh, joints, owners, joint)
            while neighbour is not None:
                owners = np.where(owners == joint, neighbour, owners)
                has_merged = True
                joint = neighbour
                neighbour = _better_joint(mesh, joints, owners, joint)
    kept, owners = np.unique(owners, return_inverse=True)
    return joints[kept], owners


def _better_joint(mesh: Mesh, joints: FloatArray, owners: IntArray, junction: int) -> int | None:
    """Return the neighbour with which a junction should merge; None if it should not merge.

    For each neighbour, the distances of the vertices of both parts from the neighbour are compared.
    The neighbour at which they spread least is returned, if they spread clearly less than those of
    the part of the junction from the junction.

    Parameters
    ----------
    mesh
        The surface.
    joints
        Positions, shape (k, 3).
    owners
        Joint of each vertex, shape (n,).
    junction
        Index of the joint.
    """
    in_part = owners == junction
    if not in_part.any():  # it was merged into another one
        return None
    bones = _bones(mesh, owners)
    neighbours = np.setdiff1d(bones[(bones == junction).any(axis=1)], junction)
    spreads = []
    for neighbour in neighbours:
        in_both = in_part | (owners == neighbour)
        spreads.append(_spread(mesh.vertices[in_both], joints[neighbour]))
    present_spread = _spread(mesh.vertices[in_part], joints[junction])
    if min(spreads, default=np.inf) >= CENTREDNESS_GAIN * present_spread:
        return None
    return int(neighbours[np.argmin(spreads)])


def _absorb_pockets(
    mesh: Mesh, joints: FloatArray, owners: IntArray
) -> tuple[FloatArray, IntArray]:
    """Remove the ends of a skeleton that lie in dents of the surface, such as a mouth.

    The surface of a limb faces away from its joint; that of a dent, which is called a pocket here,
    faces its joint, so that the flux from the joint is negative. The part of a pocket is merged
    with the part of its neighbour.

    Parameters
    ----------
    mesh
        Closed surface.
    joints
        Positions, shape (k, 3).
    owners
        Joint of each vertex, shape (n,).

    Returns
    -------
    joints : numpy.ndarray
        Positions of the joints that are left, shape (l, 3).
    owners : numpy.ndarray
        Joint of each vertex among these, shape (n,).
    """
    while True:
        bones = _bones(mesh, owners)
        n_bones = np.bincount(bones.ravel(), minlength=len(joints))
        flux = _flux_from_joints(mesh, joints, owners)
        pockets = np.flatnonzero((n_bones == 1) & (flux < 0))
        if not len(pockets):
            return joints, owners
        pocket = int(pockets[0])
        only_bone = bones[(bones == pocket).any(axis=1)]
        mouth = int(only_bone.sum()) - pocket  # the other end of the bone
        joints = np.delete(joints, pocket, axis=0)
        owners = _absorb(owners, pocket, mouth)


def _flux_from_joints(mesh: Mesh, joints: FloatArray, owners: IntArray) -> FloatArray:
    """Return the flux of the vectors from each joint through its part of the surface, shape (k,).

    It is positive if the surface faces away from the joint, as around a limb, and negative in a
    dent.

    Parameters
    ----------
    mesh
        Closed surface.
    joints
        Positions, shape (k, 3).
    owners
        Joint of each vertex, shape (n,).
    """
    corners = mesh.vertices[mesh.faces]
    middles = corners.mean(axis=1)
    # The sign of the volume: 1 if the normals point outwards, -1 if inwards.
    outwards = np.sign(np.einsum("fi,fi->", mesh.face_normals, corners[:, 0]))
    # The joint that owns most corners of a triangle; if all three differ, the middle number.
    joint_of_face = np.sort(owners[mesh.faces], axis=1)[:, 1]
    from_joints = middles - joints[joint_of_face]
    flux_of_face = outwards * np.einsum("fi,fi->f", mesh.face_normals, from_joints)
    flux = np.bincount(joint_of_face, flux_of_face, len(joints))
    return np.asarray(flux, dtype=np.float64)


def _absorb(owners: IntArray, part: int, into: int) -> IntArray:
    """Return the owners after a part has joined another; the numbers of later parts move up."""
    joined = np.where(owners == part, into, owners)
    return np.asarray(joined - (joined > part))


def _spread(points: FloatArray, joint: FloatArray) -> float:
    """Return the standard deviation of the distances of points from a joint."""
    return float(np.linalg.norm(points - joint, axis=1).std())


def _absorb_specks(owners: IntArray, edges: IntArray, areas: FloatArray) -> IntArray:
    """Merge pieces below ``SPECK_SHARE`` of the area into the neighbour with most common edges."""
    while True:
        shares = np.bincount(owners, weights=areas) / areas.sum()
        speck = int(shares.argmin())
        if shares[speck] >= SPECK_SHARE or len(shares) == 1:
            return owners
        ends = owners[np.concatenate([edges, edges[:, ::-1]])]
        neighbours = ends[(ends[:, 0] == speck) & (ends[:, 1] != speck), 1]
        owners = _absorb(owners, speck, int(np.bincount(neighbours).argmax()))

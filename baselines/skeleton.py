"""Skeleton-based form: the canonical pose of a curve skeleton, transferred back to the surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
    UnsupportedShape,
)
from benchmark.geometry.mesh import IntArray, Mesh

if TYPE_CHECKING:
    from baselines._kernels.curve_skeleton import CurveSkeleton
    from benchmark.geometry.laplacian import Laplacian

SLIVER = 1e-6
"""Areas below this share of the mean are raised to it, so that cotangents stay finite."""


@dataclass(frozen=True, kw_only=True)
class Skeleton(CheckedParameters):
    r"""Skeleton-based canonical form (Pickup, Sun, Rosin & Martin 2016).

    1. Curve skeleton. A closed surface is contracted by constrained Laplacian smoothing, collapsed
       to a graph and centred (Au et al. 2008). Contraction would erode an open surface, such as a
       depth view, from its borders. Its joints are the connected pieces of bands between level sets
       of the geodesic distance from an extremity. A closed surface whose contraction fails is
       treated in the same way.
    2. Pose. Shortest paths along the bones are the distances between joints, and least-squares MDS,
       started at the joints, gives their new positions.
    3. Surface. Each bone turns by the minimal rotation from its old to its new direction, each
       triangle turns with its bone, and the surface follows (Sumner & Popović 2004; Yan et al.
       2008).

    Parameters
    ----------
    max_iterations, rtol
        Stopping criteria of the MDS of the joints: number of Guttman transforms, and relative
        decrease of the stress.
    bands
        Number of level-set bands of an open surface.
    open_border
        A surface is open if its border is longer than this multiple of the square root of its area.
        A hemisphere has 2.5; the pinholes of a scan stay far below 1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="skeleton",
        title="Skeleton-based",
        cite="pickup2016skeleton",
        family="paper",
        summary=(
            "Finds the curves in the middle of the limbs, spreads them, and lets the surface "
            "follow."
        ),
        departs=(
            "Differs from the released code in five points: quadrics are summed; joints are "
            "centred by displacement, then merged; pockets are absorbed; a triangle across a "
            "border belongs to the bone between; contraction does not stop early. On open views, "
            "joints are level sets of the geodesic distance, which is another method; their "
            "number, and what counts as open, are ours."
        ),
        needs=("pairs",),
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    bands: Annotated[int, Interval(2)] = 24
    open_border: Annotated[float, Interval(0)] = 1.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface in the pose that its skeleton takes by multidimensional scaling.

        Returns
        -------
        CanonicalForm
            Its notes are the kind of skeleton (``"contraction"`` or ``"level-set"``), the reason
            for a level-set one, the numbers of joints and bones, and the edge strains.

        Raises
        ------
        UnsupportedShape
            If the skeleton has no bone.
        """
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines.smacof import guttman_transform, majorise

        mesh = shape.mesh
        skeleton, reason = self._skeleton(shape)
        if not len(skeleton.bones):
            raise UnsupportedShape(
                f"{shape.identifier}: the surface shrinks to {len(skeleton.joints)} joint without "
                "a bone",
                "leave this shape to methods that need no skeleton",
            )
        transform = partial(guttman_transform, targets=skeleton.path_lengths())
        joints, _ = majorise(
            transform, skeleton.joints, max_iterations=self.max_iterations, rtol=self.rtol
        )
        rotations = minimal_rotations(skeleton.joints, joints, skeleton.bones)
        vertices = follow_rotations(
            mesh, shape.laplacian(), rotations[bones_of_triangles(mesh, skeleton)]
        )
        return shape.form(
            vertices,
            skeleton="level-set" if reason else "contraction",
            skeleton_reason=reason,
            joints=len(joints),
            bones=len(skeleton.bones),
            **AsRigidAsPossible.of(shape).strains(vertices),
        )

    def _skeleton(self, shape: Shape) -> tuple[CurveSkeleton, str]:
        """Return the skeleton of a shape, by contraction if that works, else by level sets.

        Returns
        -------
        CurveSkeleton
            The skeleton.
        str
            Why it is one of level sets; "" if it is one of contraction.
        """
        from baselines._kernels.curve_skeleton import (
            ContractionFailed,
            contraction_skeleton,
            level_set_skeleton,
        )

        reason = "open surface"
        border = shape.mesh.edge_lengths[shape.mesh.edges.counts == 1].sum()
        if border <= self.open_border * np.sqrt(shape.mesh.area):
            try:
                skeleton = contraction_skeleton(shape.mesh)
                if len(skeleton.bones):
                    return skeleton, ""
                reason = "contraction left a single joint"
            except ContractionFailed as failure:
                reason = f"contraction failed: {failure}"
        return level_set_skeleton(shape.mesh, geodesics_from_extremity(shape), self.bands), reason


def geodesics_from_extremity(shape: Shape) -> FloatArray:
    """Return the geodesic distances from an extremity, shape (n,), in units of the mesh.

    The extremity is the vertex with the largest geodesic distance from the vertex farthest from the
    centroid in space.
    """
    vertices = shape.mesh.vertices
    areas = shape.mesh.vertex_areas
    outermost = int(np.linalg.norm(vertices - areas @ vertices / areas.sum(), axis=1).argmax())
    extremity = int(shape.geodesics_from([outermost])[0].argmax())
    return np.asarray(shape.geodesics_from([extremity])[0])


def minimal_rotations(before: FloatArray, after: FloatArray, bones: IntArray) -> FloatArray:
    """Return the minimal rotation of each bone, without twist, shape (b, 3, 3).

    Parameters
    ----------
    before, after
        Joint positions, shape (k, 3).
    bones
        Pairs of joints, shape (b, 2).
    """
    from scipy.spatial.transform import Rotation

    old = _unit(before[bones[:, 1]] - before[bones[:, 0]])
    new = _unit(after[bones[:, 1]] - after[bones[:, 0]])
    turns = [Rotation.align_vectors(b, a)[0] for a, b in zip(old, new, strict=True)]
    return np.asarray(Rotation.concatenate(turns).as_matrix())


def bones_of_triangles(mesh: Mesh, skeleton: CurveSkeleton) -> IntArray:
    """Return the bone that each triangle of the surface follows.

    - A triangle on the border of two parts follows the bone between their joints.
    - A triangle within a part follows one of the bones at its joint: the one whose direction is
      nearest to the direction from the joint to the centroid of the triangle.
    - A triangle where three parts meet counts as one within the part of the nearest joint.

    Parameters
    ----------
    mesh
        The surface.
    skeleton
        The skeleton, whose ``owners`` are the joint of each vertex.

    Returns
    -------
    numpy.ndarray
        Index of a bone for each triangle, shape (m,).
    """
    bones = skeleton.bones
    n_joints = len(skeleton.joints)
    joints_of_corners = np.sort(skeleton.owners[mesh.faces], axis=1)
    low, middle, high = joints_of_corners.T
    is_across = (low != high) & ((low == middle) | (middle == high))
    # Triangles across a border: both joints in one number, as the bones are sorted by such numbers.
    pairs_of_bones = bones[:, 0] * n_joints + bones[:, 1]
    chosen: IntArray = np.searchsorted(pairs_of_bones, low * n_joints + high)

    # The other triangles: the nearest joint of each, and the vector from it to the centroid.
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    offsets = centroids[:, None] - skeleton.joints[joints_of_corners]
    nearest_corner = np.linalg.norm(offsets, axis=2).argmin(axis=1)
    faces = np.arange(mesh.n_faces)
    nearest_joint = joints_of_corners[faces, nearest_corner]
    offset = offsets[faces, nearest_corner]
    for joint in np.unique(nearest_joint[~is_across]):
        triangles = np.flatnonzero(~is_across & (nearest_joint == joint))
        chosen[triangles] = _bones_along(skeleton, int(joint), offset[triangles])
    return chosen


def _bones_along(skeleton: CurveSkeleton, joint: int, offsets: FloatArray) -> IntArray:
    """Return the bone at a joint whose direction is nearest to each of some vectors, shape (k,).

    Parameters
    ----------
    skeleton
        The skeleton.
    joint
        Number of the joint.
    offsets
        Vectors from the joint, shape (k, 3).
    """
    bones = np.flatnonzero((skeleton.bones == joint).any(axis=1))
    far_ends = skeleton.bones[bones].sum(axis=1) - joint
    directions = _unit(skeleton.joints[far_ends] - skeleton.joints[joint])
    return np.asarray(bones[(offsets @ directions.T).argmax(axis=1)])


def _unit(vectors: FloatArray) -> FloatArray:
    """Return vectors of length 1 in the directions of the given ones."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, np.finfo(float).tiny))


def follow_rotations(mesh: Mesh, laplacian: Laplacian, rotations: FloatArray) -> FloatArray:
    r"""Return the positions of vertices for which triangles best follow prescribed rotations.

    With the area :math:`A_f` and the prescribed rotation :math:`R_f` of each triangle f, and the
    gradient :math:`F_f` of its deformation, they minimise

    .. math:: \sum_f A_f \|F_f - R_f\|_F^2 .

    A fourth vertex off its plane turns each triangle into a simplex, which has such a gradient
    (Sumner & Popović 2004; Yan et al. 2008). The fourth vertex belongs to one simplex only, where
    it matches the prescribed normal exactly; eliminating it leaves the tangential part of the
    gradient, and with it the Poisson system of the cotangent Laplacian

    .. math:: L x = b, \qquad
              b_i = \tfrac12 \sum_{f \ni i} \sum_{j \in f} \cot\alpha_{ij}^f \, R_f (p_i - p_j),

    where :math:`\alpha_{ij}^f` is the angle of triangle f opposite its side from i to j.

    Parameters
    ----------
    mesh, laplacian
        Connected surface with positions p, and its cotangent Laplacian L.
    rotations
        One rotation per triangle, shape (m, 3, 3).

    Returns
    -------
    numpy.ndarray
        Shape (n, 3); the centroid, weighted by vertex areas, does not change.
    """
    from scipy.sparse import csr_array  # lazy

    from baselines._kernels.arap import factorise_definite

    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)  # opposite each corner
    products = -(np.roll(sides, -1, axis=1) * np.roll(sides, 1, axis=1)).sum(axis=2)
    double_areas = 2 * np.maximum(mesh.face_areas, SLIVER * mesh.face_areas.mean())
    cotangents = products / double_areas[:, None]
    rotated_sides = np.einsum("fab,fkb->fka", rotations, sides)
    pulls = 0.5 * cotangents[..., None] * rotated_sides
    # Each side pulls at its two ends in opposite directions.
    load = np.zeros_like(mesh.vertices)
    np.add.at(load, np.roll(mesh.faces, -1, axis=1), pulls)
    np.add.at(load, np.roll(mesh.faces, 1, axis=1), -pulls)
    # Positions are determined up to a translation. A spring at one vertex fixes it, and has no
    # other effect as the load sums up to zero.
    system = csr_array(laplacian.stiffness, copy=True)
    system[0, 0] += system.diagonal().mean()
    positions = factorise_definite(system)(load)
    areas = mesh.vertex_areas
    return np.asarray(positions + areas @ (mesh.vertices - positions) / areas.sum())

"""Skeleton-based form: the canonical pose of a curve skeleton, transferred back to the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.frame import on_grid, principal_frame
from baselines._kernels.orientation import TIE, largest, order_by_coordinates, vertex_areas
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
    UnsupportedShape,
)
from benchmark.geometry.mesh import Mesh, edges_of

if TYPE_CHECKING:
    from baselines._kernels.curve_skeleton import CurveSkeleton


@dataclass(frozen=True, kw_only=True)
class Skeleton(CheckedParameters):
    r"""Skeleton-based canonical form (Pickup, Sun, Rosin & Martin 2016).

    1. Curve skeleton. A closed surface is contracted by constrained Laplacian smoothing, collapsed to a graph and
       centred (Au et al. 2008). Contraction would erode an open surface, such as a depth view, from its borders. Its
       joints are the connected pieces of bands between level sets of the geodesic distance from an extremity. A closed
       surface whose contraction fails is treated in the same way.
    2. Pose. Shortest paths along the bones are the distances between joints, and least-squares MDS, started at the
       joints, gives their new positions.
    3. Surface. Each bone turns by the minimal rotation from its old to its new direction, each triangle turns with its
       bone, and the surface follows (Sumner & Popović 2004; Yan et al. 2008).

    Contraction and collapse amplify the smallest difference until the skeleton changes. They therefore work in the
    frame of the principal axes, with coordinates rounded to a millionth of the size of the surface: this removes
    earlier rounding errors, and the form is the same on any processor.

    Parameters
    ----------
    max_iterations, rtol
        Stopping criteria of the MDS of the joints: number of Guttman transforms, and relative decrease of the stress.
    sampling
        Weight of even spacing relative to shape when the contracted surface collapses to a graph; 1 in the released
        code.
    bands
        Number of level-set bands of an open surface.
    open_border
        A surface is open if its border is longer than this multiple of the square root of its area. A hemisphere has
        2.5; the pinholes of a scan stay far below 1.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="skeleton",
        title="Skeleton-based",
        cite="pickup2016skeleton",
        family="paper",
        summary="curve skeleton scaled by its path lengths, surface transferred",
        departs=(
            "Against the released code: sampling weight .1, not 1 (`sampling=1`), summed quadrics, joints centred "
            "by displacement instead of loop centroids and merged after centring, pockets absorbed, triangles across a "
            "border assigned to the bone between; contraction goes on where that code stops. On open views joints are "
            "level sets of the geodesic distance, which is another method."
        ),
    )

    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    sampling: Annotated[float, Interval(0, closed="neither")] = 0.1
    bands: Annotated[int, Interval(2)] = 24
    open_border: Annotated[float, Interval(0)] = 1.0

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface in the pose of its scaled skeleton.

        The notes give the kind of skeleton (``"contraction"`` or ``"level-set"``), the reason for a level-set one, the
        numbers of joints, bones and leaves, the stress of the joints, and the mean edge strain.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices or no face, is in several pieces, or its skeleton has no bone.
        """
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines._kernels.deformation_transfer import follow_rotations
        from baselines._kernels.smacof import smacof

        require_vertices(shape)
        require_connected(shape)
        # Sums over the surface must not depend on the numbering of the vertices, nor ties on rounding: so the vertices
        # are sorted by their coordinates, first the given and then the rounded ones.
        order = np.asarray(np.lexsort(shape.mesh.vertices.T[::-1]), dtype=np.int64)
        mesh = _relabelled(shape.mesh, order)
        frame = principal_frame(mesh)
        mesh = on_grid(mesh, frame)
        reordered = order_by_coordinates(mesh.vertices, 1.0)
        order, mesh = order[reordered], _relabelled(mesh, reordered)
        skeleton, kind, reason = self._skeleton(shape, mesh, order)
        if not len(skeleton.bones):
            raise UnsupportedShape(
                f"{shape.identifier}: the surface shrinks to {len(skeleton.joints)} joint without a bone",
                "leave this shape to methods that need no skeleton",
            )
        scaling = smacof(skeleton.path_lengths(), skeleton.joints, max_iterations=self.max_iterations, rtol=self.rtol)
        rotations = bone_rotations(skeleton.joints, scaling.points, skeleton.bones)
        moved = follow_rotations(mesh, rotations[bones_of_triangles(mesh, skeleton)])
        vertices = np.empty_like(moved)
        vertices[order] = frame.points(moved)
        return shape.form(
            vertices,
            skeleton=kind,
            skeleton_reason=reason,
            joints=len(skeleton.joints),
            bones=len(skeleton.bones),
            leaves=int((skeleton.degrees == 1).sum()),
            joint_stress=scaling.stress[-1],
            mean_edge_strain=float(AsRigidAsPossible.of(shape).edge_strains(vertices).mean()),
        )

    def _skeleton(self, shape: Shape, mesh: Mesh, order: NDArray[np.int64]) -> tuple[CurveSkeleton, str, str]:
        from baselines._kernels.contraction import ContractionFailed, contract
        from baselines._kernels.curve_skeleton import contraction_skeleton, level_set_skeleton

        if border_length(mesh) > self.open_border * np.sqrt(mesh.area):
            reason = "open surface"
        else:
            try:
                skeleton = contraction_skeleton(mesh, contract(mesh), self.sampling)
            except ContractionFailed as failure:
                reason = f"contraction failed: {failure}"
            else:
                if len(skeleton.bones):
                    return skeleton, "contraction", ""
                reason = "contraction left a single joint"
        levels = geodesics_from_extremity(shape)[order] / np.sqrt(shape.mesh.area)
        return level_set_skeleton(mesh, levels, self.bands), "level-set", reason


def geodesics_from_extremity(shape: Shape) -> FloatArray:
    """Return the geodesic distances from an extremity of the surface, shape (n,), in units of the mesh.

    The extremity is the vertex with the largest geodesic distance from the vertex farthest from the centroid in space.
    """
    areas = vertex_areas(shape.mesh)
    centroid = areas @ shape.mesh.vertices / areas.sum()
    outermost = largest(np.linalg.norm(shape.mesh.vertices - centroid, axis=1), shape.mesh.vertices)
    extremity = largest(shape.geodesics_from([outermost])[0], shape.mesh.vertices)
    return np.asarray(shape.geodesics_from([extremity])[0])


def border_length(mesh: Mesh) -> float:
    """Return the total length of the edges that belong to a single triangle, in units of the mesh."""
    border = edges_of(mesh.faces).boundary
    return float(np.linalg.norm(mesh.vertices[border[:, 0]] - mesh.vertices[border[:, 1]], axis=1).sum())


def bone_rotations(before: FloatArray, after: FloatArray, bones: NDArray[np.int64]) -> FloatArray:
    """Return the minimal rotation of each bone, without twist, shape (b, 3, 3) (Rodrigues' formula).

    Parameters
    ----------
    before, after
        Joint positions, shape (k, 3).
    bones
        Pairs of joints, shape (b, 2).
    """
    old, new = (_unit(joints[bones[:, 1]] - joints[bones[:, 0]]) for joints in (before, after))
    cosine = np.einsum("bi,bi->b", old, new)
    axis = np.cross(old, new)
    # The minimal rotation of a reversed bone is not unique; any half turn about a perpendicular axis will do.
    reversed_ = cosine < -1 + 1e-12
    axis[reversed_] = 0.0
    skew = np.zeros((len(bones), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    skew -= skew.transpose(0, 2, 1)
    rotations = np.eye(3) + skew + skew @ skew / np.where(reversed_, 1.0, 1.0 + cosine)[:, None, None]
    for b in np.flatnonzero(reversed_):
        perpendicular = _unit(np.cross(old[b], np.eye(3)[np.abs(old[b]).argmin()])[None])[0]
        rotations[b] = 2 * np.outer(perpendicular, perpendicular) - np.eye(3)
    return rotations


def bones_of_triangles(mesh: Mesh, skeleton: CurveSkeleton) -> NDArray[np.int64]:
    """Return the bone that each triangle follows, shape (m,).

    A triangle across the border of two parts follows the bone between their joints. Any other triangle follows, among
    the bones at its joint, the one whose direction is nearest to that of the triangle's centroid: the bisecting planes
    between the bones divide the triangles of a joint.
    """
    bones, k = skeleton.bones, len(skeleton.joints)
    corners = np.sort(skeleton.owners[mesh.faces], axis=1)
    low, middle, high = corners.T
    across = (low != high) & ((low == middle) | (middle == high))
    chosen: NDArray[np.int64] = np.searchsorted(bones[:, 0] * k + bones[:, 1], low * k + high)
    offsets = mesh.vertices[mesh.faces].mean(axis=1) - skeleton.joints[middle]
    # Bones are sorted, so the search finds each pair that exists; the loop treats the other triangles joint by joint.
    for joint in np.unique(middle[~across]):
        incident = np.flatnonzero((bones == joint).any(axis=1))
        directions = _unit(skeleton.joints[bones[incident].sum(axis=1) - joint] - skeleton.joints[joint])
        own = np.flatnonzero(~across & (middle == joint))
        along = offsets[own] @ directions.T
        near = along >= along.max(axis=1, keepdims=True) - TIE * np.linalg.norm(offsets[own], axis=1, keepdims=True)
        # argmax finds the first True, hence the first of equally near directions.
        chosen[own] = incident[near.argmax(axis=1)]
    return chosen


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), np.finfo(float).tiny))


def _relabelled(mesh: Mesh, order: NDArray[np.int64]) -> Mesh:
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    faces = rank[mesh.faces]
    # Turning a triangle so that its smallest corner leads keeps its orientation.
    lead = faces.argmin(axis=1)
    faces = np.take_along_axis(faces, (lead[:, None] + np.arange(3)) % 3, axis=1)
    return Mesh(mesh.vertices[order], faces[np.lexsort(faces.T[::-1])])

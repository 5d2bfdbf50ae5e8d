"""Skin on bones: smooth weights, dual quaternion blending, and a relaxation that keeps edges as long as they were."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.geometry.mesh import Mesh

HEAT = 0.5
"""Heat that flows from a bone to the skin above it, against the flow along the skin; Baran and Popović use 1."""

ANCHOR = 0.02
"""Stiffness of the springs that hold the relaxed skin to the blended one, against the stiffness of the skin."""


def bone_weights(mesh: Mesh, owners: NDArray[np.int64], skeleton: Skeleton) -> NDArray[np.float64]:
    """Weights of the bones by heat diffusion over the skin (Baran and Popović, Pinocchio, 2007, section 4).

    Parameters
    ----------
    mesh
        The skin in the rest pose.
    owners
        Bone that owns each vertex, shape (n,).
    skeleton
        The bones in the rest pose.

    Returns
    -------
    numpy.ndarray
        Shape (n, bones), non-negative, rows sum to one.
    """
    import igl

    vertices, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
    stiffness = -igl.cotmatrix(vertices, faces)
    area = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_VORONOI).diagonal()
    joints = np.array([bone.joint for bone in skeleton.bones])[owners]
    spans = np.array([bone.end - bone.joint for bone in skeleton.bones])[owners]
    along = np.clip(((vertices - joints) * spans).sum(axis=1) / (spans**2).sum(axis=1), 0.0, 1.0)
    squared = ((vertices - joints - along[:, None] * spans) ** 2).sum(axis=1)
    source = HEAT * area / squared
    indicator = np.zeros((mesh.n_vertices, len(skeleton.bones)))
    indicator[np.arange(mesh.n_vertices), owners] = 1.0
    weights = splu((stiffness + sparse.diags(source)).tocsc()).solve(source[:, None] * indicator)
    weights = np.maximum(weights, 0.0)
    weights[weights < 1e-4] = 0.0
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def blend(
    vertices: NDArray[np.float64], weights: NDArray[np.float64], rotations: Rotation, translations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Dual quaternion blending (Kavan, Collins, Žára and O'Sullivan, 2008, section 4).

    Parameters
    ----------
    vertices
        Rest positions, shape (n, 3).
    weights
        Shape (n, bones), rows sum to one.
    rotations, translations
        One rigid motion per bone; translations have shape (bones, 3).

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    real = rotations.as_quat()
    shift = np.column_stack([translations, np.zeros(len(translations))])
    dual = 0.5 * _multiply(shift, real)
    # q and -q are one rotation: blend all on the side of the bone that weighs most.
    main = real[weights.argmax(axis=1)]
    signed = weights * np.where(main @ real.T < 0.0, -1.0, 1.0)
    blended, moved = signed @ real, signed @ dual
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    blended, moved = blended / length, moved / length
    shift = 2.0 * _multiply(moved, blended * [-1.0, -1.0, -1.0, 1.0])[:, :3]
    return np.asarray(Rotation.from_quat(blended).apply(vertices) + shift)


def _multiply(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hamilton product of quaternions stored as (x, y, z, w), shape (n, 4)."""
    vector = p[:, 3:] * q[:, :3] + q[:, 3:] * p[:, :3] + np.cross(p[:, :3], q[:, :3])
    scalar = p[:, 3] * q[:, 3] - (p[:, :3] * q[:, :3]).sum(axis=1)
    return np.column_stack([vector, scalar])


@dataclass(frozen=True)
class Relaxation:
    """As-rigid-as-possible relaxation (Sorkine and Alexa, 2007) around anchors, factorised once per skin.

    Minimises sum_ij w_ij |(x_i - x_j) - R_i (p_i - p_j)|^2 + sum_i s_i |x_i - y_i|^2 over positions x and rotations R,
    with rest positions p, anchors y and cotangent weights w.
    """

    rest: NDArray[np.float64]
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    stiffness: NDArray[np.float64]
    springs: NDArray[np.float64]
    gather: Any
    factor: Any

    @classmethod
    def of(cls, mesh: Mesh, weights: NDArray[np.float64]) -> Relaxation:
        """Prepare the relaxation of a skin; the springs are strong where one bone rules and weak at the joints."""
        import igl

        rest, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
        laplacian = -igl.cotmatrix(rest, faces)
        off = sparse.triu(laplacian, k=1).tocoo()
        positive = np.maximum(-off.data, 1e-3)
        start, end = np.r_[off.row, off.col].astype(np.int64), np.r_[off.col, off.row].astype(np.int64)
        stiffness = np.r_[positive, positive]
        n = mesh.n_vertices
        gather = sparse.csr_matrix((np.ones(len(start)), (start, np.arange(len(start)))), shape=(n, len(start)))
        springs = ANCHOR * weights.max(axis=1) ** 4
        system = sparse.diags(np.bincount(start, stiffness, n) + springs) - sparse.csr_matrix(
            (stiffness, (start, end)), shape=(n, n)
        )
        return cls(rest, start, end, stiffness, springs, gather, splu(system.tocsc()))

    def __call__(self, anchors: NDArray[np.float64], iterations: int) -> NDArray[np.float64]:
        """Relax from the anchors, shape (n, 3), by alternating local and global steps."""
        edges = self.rest[self.start] - self.rest[self.end]
        x = anchors
        for _ in range(iterations):
            now = self.stiffness[:, None] * (x[self.start] - x[self.end])
            covariance = (self.gather @ (now[:, :, None] * edges[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
            u, _, vt = np.linalg.svd(covariance)
            u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
            rotation = u @ vt
            mean = 0.5 * (rotation[self.start] + rotation[self.end])
            force = self.gather @ (self.stiffness[:, None] * np.einsum("eij,ej->ei", mean, edges))
            x = self.factor.solve(force + self.springs[:, None] * anchors)
        return np.asarray(x)

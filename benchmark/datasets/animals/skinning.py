"""Skinning: smooth bone weights, and blending of bone motions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from benchmark.datasets.animals.skeleton import Skeleton
from benchmark.geometry.laplacian import cotangent_laplacian
from benchmark.geometry.mesh import Mesh

HEAT = 1.0
"""Heat flow from a bone to the skin above it, relative to the flow along the skin."""


def bone_weights(mesh: Mesh, owners: NDArray[np.int64], skeleton: Skeleton) -> NDArray[np.float64]:
    """Compute bone weights by heat diffusion over the skin (Baran and Popović, Pinocchio, 2007, section 4).

    Parameters
    ----------
    mesh
        The skin in the rest pose.
    owners
        Bone of each vertex, shape (n,).
    skeleton
        The bones in the rest pose.

    Returns
    -------
    numpy.ndarray
        Weights, shape (n, bones), non-negative, rows sum to one.
    """
    import igl

    vertices, faces = np.array(mesh.vertices), mesh.faces.astype(np.int64)
    stiffness = cotangent_laplacian(mesh).stiffness
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
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pose vertices by dual quaternion blending (Kavan, Collins, Žára and O'Sullivan, 2008, section 4).

    Parameters
    ----------
    vertices
        Rest positions, shape (n, 3).
    weights
        Bone weights, shape (n, bones), rows sum to one.
    rotations, translations
        One rigid motion per bone; translations have shape (bones, 3).

    Returns
    -------
    numpy.ndarray, numpy.ndarray
        Posed positions, shape (n, 3), and rotations of the skin, shape (n, 3, 3).
    """
    real = rotations.as_quat()
    shift = np.column_stack([translations, np.zeros(len(translations))])
    dual = 0.5 * _multiply(shift, real)
    # q and -q are the same rotation: blend all on the side of the bone with the largest weight.
    main = real[weights.argmax(axis=1)]
    signed = weights * np.where(main @ real.T < 0.0, -1.0, 1.0)
    blended, moved = signed @ real, signed @ dual
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    blended, moved = blended / length, moved / length
    shift = 2.0 * _multiply(moved, blended * [-1.0, -1.0, -1.0, 1.0])[:, :3]
    turned = Rotation.from_quat(blended)
    return np.asarray(turned.apply(vertices) + shift), np.asarray(turned.as_matrix())


def _multiply(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Hamilton product of quaternions stored as (x, y, z, w), shape (n, 4)."""
    vector = p[:, 3:] * q[:, :3] + q[:, 3:] * p[:, :3] + np.cross(p[:, :3], q[:, :3])
    scalar = p[:, 3] * q[:, 3] - (p[:, :3] * q[:, :3]).sum(axis=1)
    return np.column_stack([vector, scalar])

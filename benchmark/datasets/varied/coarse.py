"""Reduced body model with fewer triangles and only the bones that poses rotate, for posing a whole batch at once."""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmark.datasets.skinning import linear_blend_skinning
from benchmark.datasets.varied.bodies import Body
from benchmark.datasets.varied.joints import batch_rotations
from benchmark.datasets.varied.model import BodyModel, body_model, one_thread
from benchmark.geometry.mesh import Faces, Mesh
from benchmark.geometry.preparation import filtered

_DECIMALS = 6
"""Decimals of coordinates in metres: micrometres, far above the rounding differences between batches."""


@dataclass(frozen=True, eq=False)
class Resting:
    """A body in the pose without angles: vertices, shape (n, 3), and joints, shape (k, 3)."""

    vertices: NDArray[np.float64]
    joints: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CoarseModel:
    """The body model on a subset of its vertices; the mean deviation of vertices from the full model is .3 mm.

    Parameters
    ----------
    faces
        Triangles of every body, shape (m, 3); a closed surface.
    hands
        Masks of the triangles of the left and the right hand, each of shape (m,).
    full
        The body model on these vertices, with all bones.
    names, places, parents
        Name, index in the body model and parent index of the k bones that poses rotate, parents first.
    bones, weights
        Indices and weights of these bones for each vertex, shape (n, j) each.
    """

    faces: Faces
    hands: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    full: BodyModel
    names: tuple[str, ...]
    places: NDArray[np.int64]
    parents: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: NDArray[np.float64]

    def shaped(self, bodies: Sequence[Body]) -> list[Resting]:
        """Return bodies ready for posing."""
        import torch

        with one_thread(), torch.inference_mode():
            resting = self.full.shaped(bodies)
            moved, poses = self.full.model.get_bone_transforms(None, torch.stack([body.bones for body in resting]))
        rest = np.stack([body.vertices for body in resting])
        vertices = linear_blend_skinning(rest, self.full.bones, self.full.weights, np.ascontiguousarray(moved.numpy()))
        return list(map(Resting, vertices, poses.numpy()[:, self.places][:, :, :3, 3]))

    def posed(self, bodies: Sequence[Resting], angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vertices of each body in a pose, shape (b, n, 3); metres, z up, facing -y.

        The rotation of a bone about its joint, in world axes, precedes those of its parents.

        Parameters
        ----------
        bodies
            The b bodies.
        angles
            Pose of each body in the order of :meth:`benchmark.datasets.human_poses.Pose.angles`, shape (b, 27).
        """
        rotations, joints = batch_rotations(angles), np.stack([body.joints for body in bodies])[..., None]
        moved = np.zeros((len(bodies), len(self.names), 4, 4))
        for place, (name, parent) in enumerate(zip(self.names, self.parents, strict=True)):
            turn, joint = rotations[name], joints[:, place]
            shift = joint - turn @ joint
            if parent >= 0:
                before = moved[:, parent, :3]
                turn, shift = before[..., :3] @ turn, before[..., :3] @ shift + before[..., 3:]
            moved[:, place, :3, :3], moved[:, place, :3, 3:] = turn, shift
        rest = np.stack([body.vertices for body in bodies])
        return np.asarray(np.round(linear_blend_skinning(rest, self.bones, self.weights, moved), _DECIMALS))


@functools.cache
def coarse_model(triangles: int) -> CoarseModel:
    """Return the model on a subset of its vertices, from quadric decimation of the template without moving vertices.

    Parameters
    ----------
    triangles
        Number of triangles of a body.

    Raises
    ------
    DatasetError
        If the packages for generating bodies are missing.

    References
    ----------
    Garland and Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997.
    """
    fine = body_model()
    # The last bits depend on the processor and would decide between equal errors.
    template = np.round(fine.model.template_vertices.numpy()[fine.rows], _DECIMALS)
    coarse = filtered(
        Mesh(template, fine.faces),
        "meshing_decimation_quadric_edge_collapse",
        targetfacenum=triangles,
        targetperc=0.0,
        qualitythr=0.3,
        preserveboundary=False,
        boundaryweight=1.0,
        preservenormal=True,
        preservetopology=True,
        optimalplacement=False,
        planarquadric=False,
        planarweight=0.001,
        qualityweight=False,
        autoclean=True,
        selected=False,
    )
    kept = cKDTree(template).query(coarse.vertices)[1]
    faces = coarse.faces
    left, right = (np.asarray(np.isin(kept, fine.faces[hand])[faces].all(axis=1)) for hand in fine.hands)
    model, rows = copy.copy(fine.model), fine.rows[kept]
    model._buffers = dict(model._buffers)
    model.template_vertices, model.blendshapes = model.template_vertices[rows], model.blendshapes[:, rows].contiguous()
    full = BodyModel(faces, (left, right), model, np.arange(len(rows)), fine.bones[kept], fine.weights[kept])
    turning = batch_rotations(np.zeros((1, 27)))
    places = np.array([place for place, name in enumerate(model.bone_labels) if name in turning])
    # A bone that never rotates follows its nearest rotating ancestor.
    follows = np.full(len(model.bone_labels) + 1, -1)
    for place, parent in enumerate(model.bone_parents):
        follows[place] = np.flatnonzero(places == place)[0] if place in places else follows[parent]
    parents = np.array([follows[model.bone_parents[place]] for place in places])
    shares = np.zeros((len(rows), len(places)))
    np.add.at(shares, (np.arange(len(rows))[:, None], follows[full.bones]), full.weights)
    most = int((shares > 0).sum(axis=1).max())
    bones = np.argsort(-shares, axis=1, kind="stable")[:, :most]
    names = tuple(model.bone_labels[place] for place in places)
    weights = np.take_along_axis(shares, bones, axis=1)
    return CoarseModel(faces, (left, right), full, names, places, parents, np.ascontiguousarray(bones), weights)

"""Batches of body meshes with local changes: each body is shaped once and can then be posed repeatedly."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.human_poses import POSES, Pose, bone_rotations
from benchmark.datasets.humans import CANONICAL_POSE
from benchmark.datasets.skinning import linear_blend_skinning
from benchmark.datasets.varied.bodies import LABELS, Body
from benchmark.errors import DatasetError
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.mesh import Faces, Mesh

CANONICAL: Pose = POSES[CANONICAL_POSE]
"""Pose to predict."""

_DECIMALS = 6
"""Decimals of coordinates in metres: micrometres, far above the rounding differences between batches."""

_HANDS = ("wrist", "metacarpal", "finger")
"""Prefixes of the names of hand bones."""


@dataclass(frozen=True, eq=False)
class Shaped:
    """A body at rest: vertices, shape (n, 3), and bone transforms, a tensor of shape (bones, 4, 4)."""

    vertices: NDArray[np.float64]
    bones: Any


@dataclass(frozen=True, eq=False)
class BodyModel:
    """The parametric body model, without eyes and tongue.

    Parameters
    ----------
    faces
        Triangles of every body, shape (m, 3).
    hands
        Masks of the triangles of the left and the right hand, each of shape (m,).
    model
        The model of the package ``anny``.
    rows
        Indices of the n vertices of a body in the model.
    bones, weights
        Bones of each vertex and their weights, shape (n, k) each.
    """

    faces: Faces
    hands: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    model: Any
    rows: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: NDArray[np.float64]

    def shaped(self, bodies: Sequence[Body]) -> list[Shaped]:
        """Return bodies at rest, ready for posing."""
        import torch

        with one_thread(), torch.inference_mode():
            rest = self.model.get_rest_model(self._coefficients(bodies))
            shapes = rest["rest_vertices"].numpy()[:, self.rows]
            return [Shaped(shape, bones) for shape, bones in zip(shapes, rest["rest_bone_poses"], strict=True)]

    def posed(self, bodies: Sequence[Shaped], poses: Sequence[Sequence[Pose]]) -> list[NDArray[np.float64]]:
        """Return the vertices of each body in its poses, shape (poses, n, 3) per body; metres, z up, facing -y.

        Parameters
        ----------
        bodies
            The bodies.
        poses
            The poses of each body, the same number for all.
        """
        import torch

        count = len(poses[0])
        with one_thread(), torch.inference_mode():
            bones = torch.stack([body.bones for body in bodies]).repeat_interleave(count, dim=0)
            moved = self.model.get_bone_transforms(_rotations(poses), bones)[0].numpy()
        posed = []
        for number, body in enumerate(bodies):
            of_body = moved[number * count : (number + 1) * count]
            repeated = np.broadcast_to(body.vertices, (count, *body.vertices.shape)).astype(np.float64, order="C")
            skinned = linear_blend_skinning(repeated, self.bones, self.weights, np.ascontiguousarray(of_body))
            posed.append(np.round(skinned, _DECIMALS))
        return posed

    def vertices(self, bodies: Sequence[Body], poses: Sequence[Sequence[Pose]]) -> list[NDArray[np.float64]]:
        """Return the vertices of unshaped bodies in their poses; see :meth:`posed`."""
        return self.posed(self.shaped(bodies), poses)

    def _coefficients(self, bodies: Sequence[Body]) -> Any:
        import torch

        phenotypes = torch.tensor([astuple(body.subject) for body in bodies], dtype=torch.float64)
        named = {name: phenotypes[:, place] for place, name in enumerate(asdict(bodies[0].subject))}
        values = torch.tensor([body.local for body in bodies], dtype=torch.float64)
        local = {name: values[:, place] for place, name in enumerate(LABELS)}
        parsed = self.model.get_tensor_inputs(None, named, local, None)
        return self.model._get_phenotype_blendshape_coefficients(*parsed[1:])


@functools.cache
def body_model() -> BodyModel:
    """Return the model, loaded once.

    Raises
    ------
    DatasetError
        If the packages for generating bodies are missing.
    """
    try:
        import anny
    except ImportError as error:
        package = (error.name or "anny").partition(".")[0]
        raise DatasetError(f"generated humans need the package '{package}'", f"run `pip install {package}`") from error
    model = anny.Anny(local_changes=list(LABELS), skinning_method="lbs", pose_parameterization="local-ref")
    faces = model.get_triangular_faces().numpy().astype(np.int32)
    labels = connected_components(Mesh(model.template_vertices.numpy(), faces))
    # Eyes and tongue are separate components inside the head.
    keep = labels == np.bincount(labels).argmax()
    renumbered = np.cumsum(keep, dtype=np.int32) - 1
    kept_faces = renumbered[faces[keep[faces[:, 0]]]]
    rows = np.flatnonzero(keep)
    bones = np.ascontiguousarray(model.vertex_bone_indices.numpy()[rows].astype(np.int64))
    weights = np.ascontiguousarray(model.vertex_bone_weights.numpy()[rows].astype(np.float64))
    strongest = bones[np.arange(len(rows)), weights.argmax(axis=1)]
    names = [model.bone_labels[bone] for bone in strongest]
    left, right = (
        np.array([name.startswith(_HANDS) and name.endswith(side) for name in names])[kept_faces].all(axis=1)
        for side in (".L", ".R")
    )
    return BodyModel(kept_faces, (left, right), model, rows.astype(np.int64), bones, weights)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch to one thread, for bitwise identical results on all machines."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _rotations(poses: Sequence[Sequence[Pose]]) -> dict[str, Any]:
    """Return the bone transforms of all poses, concatenated, each of shape (bodies * poses, 4, 4)."""
    import torch

    of_poses = [bone_rotations(pose) for of_body in poses for pose in of_body]
    transforms = {bone: np.tile(np.eye(4), (len(of_poses), 1, 1)) for bone in of_poses[0]}
    for row, rotations in enumerate(of_poses):
        for bone, rotation in rotations.items():
            transforms[bone][row, :3, :3] = rotation
    return {bone: torch.from_numpy(matrices) for bone, matrices in transforms.items()}

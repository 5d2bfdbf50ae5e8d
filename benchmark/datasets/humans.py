"""Generated humans: the stand-in for the synthetic part of SHREC'14 [Pickup et al. 2014].

The official set has 15 bodies (5 men, 5 women, 5 children) in the same 20 poses. The stand-in does the same with the
parametric body of the package ``anny`` [Brégier et al. 2025; its assets descend from MakeHuman and are CC0]: blend
shapes for the body, linear blend skinning for the pose. The result is deterministic and independent of the batch size.
"""

from __future__ import annotations

import functools
import itertools
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.human_poses import POSES, Pose, bone_rotations, perturbed_pose
from benchmark.datasets.human_subjects import Subject, new_subject
from benchmark.errors import DatasetError
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.mesh import Faces, Mesh

CANONICAL_POSE = next(iter(POSES))
"""Pose whose depth image a learned method predicts."""

_BATCH = 20
"""Shapes per batch: about 100 MiB of working memory."""

_DECIMALS = 6
"""Decimals of coordinates in metres: micrometres, far above the rounding differences between batches (1e-15 m)."""


@dataclass(frozen=True)
class _Body:
    model: Any
    keep: NDArray[np.bool_]
    faces: Faces
    bones: tuple[str, ...]


def human_mesh(subject: Subject, pose: Pose) -> Mesh:
    """Generate the mesh of a body in a pose; see :func:`human_meshes`."""
    return next(human_meshes([(subject, pose)]))


def human_meshes(pairs: Iterable[tuple[Subject, Pose]]) -> Iterator[Mesh]:
    """Generate meshes of bodies in poses, in batches.

    Parameters
    ----------
    pairs
        A body and a pose for each mesh.

    Yields
    ------
    Mesh
        13 348 vertices and 26 692 triangles, closed, of genus 0, in one-to-one correspondence; metres, z up, facing
        -y, left hand towards +x.

    Raises
    ------
    DatasetError
        If the packages for generating bodies are missing.
    """
    body = _body()
    remaining = iter(pairs)
    while batch := list(itertools.islice(remaining, _BATCH)):
        for vertices in _skinned(body.model, batch):
            yield Mesh(np.round(vertices[body.keep], _DECIMALS), body.faces)


def vertices_of(bones: tuple[str, ...], side: str = "") -> NDArray[np.int64]:
    """Return the indices of vertices dominated by the given bones.

    Parameters
    ----------
    bones
        Prefixes of bone names, e.g. ``("wrist", "finger")``.
    side
        Suffix of bone names: ``".L"``, ``".R"``, or empty for any.
    """
    chosen = [bone.startswith(bones) and bone.endswith(side) for bone in _body().bones]
    return np.flatnonzero(chosen).astype(np.int64)


@functools.cache
def reference_mesh() -> Mesh:
    """Return the template of all bodies at rest; every generated mesh has the same triangles and vertex order."""
    body = _body()
    return Mesh(body.model.template_vertices.numpy()[body.keep], body.faces)


def recipe(subject: Subject, pose: Pose) -> str:
    """Return the body parameters and joint angles that determine a mesh."""
    body, angles = (np.round(values, 9).tolist() for values in (astuple(subject), pose.angles()))
    return f"body {body} with joints {angles}"


def sample_humans(n_subjects: int, n_poses: int, seed: int) -> list[tuple[Subject, Sequence[Pose]]]:
    """Draw additional bodies and poses for training.

    The bodies keep a distance from the subjects of all generated human test sets. A larger sample begins with the
    smaller one of the same seed.

    Parameters
    ----------
    n_subjects
        Number of bodies.
    n_poses
        Number of poses per body; each body has different poses.
    seed
        Random seed.

    Returns
    -------
    list of tuple
        Each body with its poses, for :func:`human_meshes`.
    """
    return [sample_human(index, n_poses, seed) for index in range(n_subjects)]


def sample_human(index: int, n_poses: int, seed: int, draw: int = 0) -> tuple[Subject, Sequence[Pose]]:
    """Draw a single body of :func:`sample_humans` with its poses: man, woman and child in turn.

    Parameters
    ----------
    index
        Index in the sample.
    n_poses, seed
        As in :func:`sample_humans`.
    draw
        Number of previous draws at this index; each draw yields another body and other poses.
    """
    further = [draw] if draw else []
    of_subject, of_poses = (np.random.default_rng([seed, index, part, *further]) for part in range(2))
    return new_subject(of_subject, index % 3), [perturbed_pose(of_poses) for _ in range(n_poses)]


def _missing(package: str) -> DatasetError:
    return DatasetError(f"generated humans need the package '{package}'", f"run `pip install {package}`")


@functools.cache
def _body() -> _Body:
    try:
        import anny
        import anny.paths
        import torch
    except ImportError as error:
        raise _missing((error.name or "anny").partition(".")[0]) from error

    if not any(anny.paths.get_anny_cache_path().glob("*/*")):
        sys.stderr.write("anny builds its cache on first use; this takes about half a minute\n")

    from benchmark.datasets.skinning import linear_blend_skinning  # imports numba

    class Body(anny.Anny):  # type: ignore[misc]
        """Model with a compiled skinning kernel in double precision.

        It is much faster than the dense kernel of the package and, unlike the Warp kernels, identical on all machines.
        """

        def get_skinned_vertices(self, rest_vertices: Any, bone_transforms: Any) -> Any:
            bones, weights = self.vertex_bone_indices.numpy(), self.vertex_bone_weights.numpy()
            return torch.from_numpy(
                linear_blend_skinning(rest_vertices.numpy(), bones, weights, bone_transforms.numpy())
            )

    model = Body(skinning_method="lbs", pose_parameterization="local-ref")
    faces = model.get_triangular_faces().numpy().astype(np.int32)
    labels = connected_components(Mesh(model.template_vertices.numpy(), faces))
    # Eyes and tongue are separate components inside the head.
    keep = labels == np.bincount(labels).argmax()
    renumbered = np.cumsum(keep, dtype=np.int32) - 1
    rows = np.flatnonzero(keep)
    strongest = model.vertex_bone_weights.numpy()[rows].argmax(axis=1)
    bones = tuple(model.bone_labels[bone] for bone in model.vertex_bone_indices.numpy()[rows, strongest])
    return _Body(model, keep, renumbered[faces[keep[faces[:, 0]]]], bones)


def _skinned(model: Any, pairs: Sequence[tuple[Subject, Pose]]) -> NDArray[np.float64]:
    """Return the vertices of the whole model, shape (pairs, n, 3)."""
    import torch

    rotations = [bone_rotations(pose) for _, pose in pairs]
    transforms = {bone: np.tile(np.eye(4), (len(pairs), 1, 1)) for bone in rotations[0]}
    for row, of_pose in enumerate(rotations):
        for bone, rotation in of_pose.items():
            transforms[bone][row, :3, :3] = rotation
    phenotypes = {
        field.name: torch.tensor([asdict(subject)[field.name] for subject, _ in pairs], dtype=torch.float64)
        for field in fields(Subject)
    }
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            result = model(
                pose_parameters={bone: torch.from_numpy(matrices) for bone, matrices in transforms.items()},
                phenotype_kwargs=phenotypes,
            )
    finally:
        torch.set_num_threads(threads)
    return np.asarray(result["vertices"].numpy(), dtype=np.float64)

"""Random people for training, each in the canonical pose and in six random poses.

They keep a distance from all tested subjects, and from the twelve bodies that judge experiments
with networks. The body of a number depends on nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.bodies import POSES, Subject, body_mesh, jittered, mirrored_pose
from benchmark.datasets.people import JUDGES, TESTED, new_subject
from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import camera_coordinates, render_depth
from benchmark.geometry.mesh import FloatArray, Mesh

N_BODIES = 10_000
"""Number of bodies."""

N_POSES = 6
"""Random poses of a body, beside the canonical one."""

N_SHAPES = 1 + N_POSES
"""Shapes of a body: the canonical pose, then the random ones."""

AWAY_FROM = (*TESTED, JUDGES)
"""Sets from whose subjects the bodies keep the distance ``benchmark.datasets.people.CLEARANCE``."""

#: Seed of all bodies and poses.
_SEED = 0

#: Standard deviation of the angles of a random pose from the mixture that it begins with, in
#: degrees.
_DEVIATION = 6.0


def sampled_body(number: int, draw: int = 0) -> tuple[Subject, list[FloatArray]]:
    """Return a body, and its joint angles in the canonical pose and in the random ones.

    Parameters
    ----------
    number
        Number of the body; men, women and children take turns.
    draw
        How often it was drawn before; each draw has another body and other poses.
    """
    further = [draw] if draw else []
    of_body = np.random.default_rng([_SEED, number, 0, *further])
    of_poses = np.random.default_rng([_SEED, number, 1, *further])
    canonical = next(iter(POSES.values()))
    body = new_subject(of_body, number % 3, away_from=(JUDGES,))
    return body, [canonical, *(_random_pose(of_poses) for _ in range(N_POSES))]


def _random_pose(random: np.random.Generator) -> FloatArray:
    """Return the angles of a perturbed pose between two authored ones, each mirrored at random."""
    authored = list(POSES.values())
    ends = []
    for number in random.integers(len(authored), size=2):
        pose = authored[number]
        ends.append(mirrored_pose(pose) if random.random() < 0.5 else pose)
    first, second = ends
    return jittered(first + random.uniform() * (second - first), _DEVIATION, random)


def sampled_images(number: int, half_width: float) -> Iterator[NDArray[np.float32]]:
    """Yield the depth images of a body from the front; a body that leaves the frame is drawn again.

    Parameters
    ----------
    number
        Number of the body.
    half_width
        Half the side of the frame, in metres.
    """
    draw = 0
    meshes = _meshes(number, draw)
    while any(_leaves_frame(mesh, half_width) for mesh in meshes):
        draw += 1
        meshes = _meshes(number, draw)
    for mesh in meshes:
        yield render_depth(mesh, FRONT, half_width)


def _meshes(number: int, draw: int) -> list[Mesh]:
    """Return the meshes of a body in all its poses."""
    body, poses = sampled_body(number, draw)
    return [body_mesh(body, pose) for pose in poses]


def _leaves_frame(mesh: Mesh, half_width: float) -> bool:
    """Return whether a body reaches beyond the frame of the camera."""
    return bool(np.abs(camera_coordinates(mesh, FRONT)).max() >= half_width)

"""Scenes that tests draw: a figure of capsules before a floor and a wall."""

from functools import cache

import numpy as np
import trimesh

from benchmark.depth.scene import KINECT, DepthFaults, Pose, Scene
from benchmark.geometry.mesh import Mesh


def capsule(start, end, radius):
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    made = trimesh.creation.capsule(height=np.linalg.norm(end - start), radius=radius, count=[24, 24])
    made.apply_translation(-made.bounds.mean(axis=0))
    made.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], end - start))
    made.apply_translation((start + end) / 2)
    return made


@cache
def figure(height=1.7):
    """A figure with trunk, head, arms and legs that stands at the origin, z up, facing -y."""
    parts = [
        capsule((0, 0, 0.85), (0, 0, 1.35), 0.16),
        capsule((0, 0, 1.6), (0, 0, 1.68), 0.11),
        capsule((0.2, 0, 1.35), (0.6, -0.05, 1.0), 0.05),
        capsule((-0.2, 0, 1.35), (-0.6, -0.05, 1.0), 0.05),
        capsule((0.1, 0, 0.85), (0.2, 0, 0.08), 0.08),
        capsule((-0.1, 0, 0.85), (-0.2, 0, 0.08), 0.08),
    ]
    made = trimesh.util.concatenate(parts)
    return Mesh(made.vertices * height / 1.79, made.faces.astype(np.int32))


def scene(distance=2.5, height=1.2, roll=0.0, wall=1.2, **further):
    return Scene(figure(), Pose((0.2, -distance, height), (0, 0, 0.85), roll), wall=wall, **further)


@cache
def frame(seed=0, **given):
    """Depths in metres as a structured-light camera measures them, and the pixels of the figure with a depth."""
    depths, mask = scene(**given).drawn(KINECT)
    measured = DepthFaults().perturbed(depths, np.random.default_rng(seed))
    return measured, mask & (measured > 0)


def overlap(one, other):
    return float((one & other).sum() / (one | other).sum())


def in_millimetres(depths):
    return np.round(1000 * depths).astype(np.uint16)

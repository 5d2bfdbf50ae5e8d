"""Generated humans with scan artefacts: the stand-in for the real part of SHREC'14 [Pickup et al. 2014].

The official set has 40 people in 10 poses each. It differs from the synthetic part by a domain shift: the bodies are
adults of usual build and more similar, nobody is symmetric or takes a pose exactly, fingers and toes are fused, and all
tessellations differ. The stand-in applies all of this to the bodies of :mod:`benchmark.datasets.humans`.
"""

from __future__ import annotations

import functools
import hashlib

import numpy as np
from numpy.typing import NDArray

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets import humans
from benchmark.datasets.human_poses import POSES, Pose, jittered
from benchmark.datasets.human_subjects import adults
from benchmark.geometry.mesh import Mesh, Points

N_VERTICES = 15_000

POSE_NAMES = (
    "standing",
    "walking",
    "running",
    "arms-up",
    "t-pose",
    "dancing",
    "lunging",
    "kicking",
    "waving",
    "throwing",
)
"""Poses without contact, which a scanner would fuse; the first is the canonical pose."""

_POSE_DEVIATION = 3.0
"""Standard deviation of a person's joint angles from the pose, in degrees."""

_WAVES, _WAVELENGTHS, _ASYMMETRY = 8, (0.3, 0.8), 0.003
"""Number, wavelengths in metres and root mean square height in metres of the waves that make a body asymmetric."""

_FUSED = (
    (("wrist", "metacarpal", "finger"), ".L"),
    (("wrist", "metacarpal", "finger"), ".R"),
    (("foot", "toe"), ".L"),
    (("foot", "toe"), ".R"),
)


def humans_scanlike() -> ShapeSet:
    """Return 40 subjects x 10 poses, ordered by subject, then by pose, like the files of SHREC'14."""
    return ShapeSet(
        name="humans-scanlike",
        title="humans, scan-like (stand-in for SHREC'14 real)",
        stand_in_for="shrec14-real",
        shapes=tuple(Entry(f"{subject}_{pose}", subject, pose) for subject in adults() for pose in POSE_NAMES),
        load=_scan,
        key=lambda entry: f"scan of {entry.identifier}: {humans.recipe(adults()[entry.subject], _pose(entry))}",
        half_width=1.345,
        code=(__name__,),
    )


def _scan(entry: Entry) -> Mesh:
    """Generate a scan: about 15 000 vertices, closed, in metres, z up, facing -y."""
    from benchmark.datasets.scanning import membrane, scan, vertex_normals  # imports numba

    # Mouth, nostrils and eye sockets are cavities behind thin lids, invisible to a scanner.
    body = membrane(humans.human_mesh(adults()[entry.subject], _pose(entry)), _cavities())
    heights = _asymmetry(_random(entry.subject, "asymmetry"))
    body = body.with_vertices(body.vertices + heights[:, np.newaxis] * vertex_normals(body))
    fused = [humans.vertices_of(bones, side) for bones, side in _FUSED]
    return scan(body, fused, N_VERTICES, _random(entry.identifier, "scan"))


def _pose(entry: Entry) -> Pose:
    return jittered(POSES[entry.pose], _POSE_DEVIATION, _random(entry.identifier, "pose"))


@functools.cache
def _cavities() -> NDArray[np.bool_]:
    from benchmark.datasets.scanning import sheltered_vertices

    template = humans.reference_mesh()
    of_head = np.zeros(template.n_vertices, dtype=bool)
    of_head[humans.vertices_of(("head", "eye"))] = True
    return sheltered_vertices(template) & of_head


def _asymmetry(random: np.random.Generator) -> Points:
    """Return the displacements of the vertices of a body along their normals, in metres, for all its poses."""
    directions = random.normal(size=(_WAVES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frequencies = 2 * np.pi / random.uniform(*_WAVELENGTHS, _WAVES)
    phases = random.uniform(0, 2 * np.pi, _WAVES)
    angles = humans.reference_mesh().vertices @ (directions * frequencies[:, np.newaxis]).T + phases
    return np.asarray(_ASYMMETRY * np.sqrt(2 / _WAVES) * np.cos(angles).sum(axis=1))


def _random(name: str, purpose: str) -> np.random.Generator:
    digest = hashlib.sha256(f"humans-scanlike|{name}|{purpose}".encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))

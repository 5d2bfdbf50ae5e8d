"""Time of the steps of the feature-preserved form against plain ones, on one body of 2000 vertices and one thread."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array, vstack
from scipy.sparse.linalg import lsqr
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import AsRigidAsPossible
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.rigid_parts import nearest_seed, rigid_motions, smooth_seams
from baselines._kernels.sampling import farthest_points
from baselines.least_squares_mds import LeastSquaresMDS
from benchmark.api.contracts import Shape
from benchmark.datasets.humans import Humans
from benchmark.geometry.preparation import prepare
from tools.speed._timing import alternately, row

FloatArray = NDArray[np.float64]
REPEATS = 5
PARTS, WIDTH = 16, 0.03


def measure() -> list[dict[str, Any]]:
    """Compare the motions of the parts and the smoothing of their seams."""
    humans = Humans()
    shape = Shape(identifier="body", mesh=prepare(humans.load(humans.entries[-1])).mesh)
    surface, masses = AsRigidAsPossible.of(shape), vertex_areas(shape.mesh)
    parts = nearest_seed(shape.geodesics()[farthest_points(shape, PARTS)])
    targets = LeastSquaresMDS().canonicalise(shape).vertices
    rotations, translations = rigid_motions(surface, targets, masses, parts)
    placed = np.einsum("nab,nb->na", rotations[parts], surface.rest) + translations[parts]
    return [
        motions(surface, shape.mesh.faces, targets, masses, parts),
        seams(surface, masses, placed, rotations[parts]),
    ]


def motions(
    surface: AsRigidAsPossible, faces: NDArray[np.integer], targets: FloatArray, masses: FloatArray, parts: Any
) -> dict[str, Any]:
    """All parts at once against one part after the other."""

    def plain() -> FloatArray:
        turns = []
        for part in range(parts.max() + 1):
            mine = np.unique(faces[(parts[faces] == part).any(axis=1)])
            rest, goal = surface.rest[mine], targets[mine]
            centre, middle = (np.average(points, axis=0, weights=masses[mine]) for points in (rest, goal))
            turns.append(Rotation.align_vectors(goal - middle, rest - centre, weights=masses[mine])[0].as_matrix())
        return np.array(turns)

    ours = partial(rigid_motions, surface, targets, masses, parts)
    seconds, peer = alternately(ours, plain, REPEATS)
    miss = np.abs(ours()[0] - plain()).max()
    return row(
        "feature-preserved, motions of the parts",
        seconds,
        peer="scipy Rotation.align_vectors, part by part",
        peer_seconds=peer,
        target="no slower, with the same result",
        met=peer >= seconds and miss <= 1e-6,
        detail=f"{PARTS} parts, largest difference {miss:.1e}",
    )


def seams(surface: AsRigidAsPossible, masses: FloatArray, placed: FloatArray, turns: FloatArray) -> dict[str, Any]:
    """One factorisation against an iterative solver that is given the edges as they are."""
    weights = surface.weights.tocoo()
    once = weights.row < weights.col
    tails, heads, roots = weights.row[once], weights.col[once], np.sqrt(weights.data[once])
    number = np.arange(len(tails))

    def plain() -> FloatArray:
        shape = (len(tails), len(placed))
        edges = coo_array((roots, (number, tails)), shape=shape) - coo_array((roots, (number, heads)), shape=shape)
        pulls = np.sqrt(masses) / WIDTH
        across = surface.rest[tails] - surface.rest[heads]
        wanted = roots[:, None] * np.einsum("nab,nb->na", (turns[tails] + turns[heads]) / 2, across)
        system = vstack([edges, diags_array(pulls)]).tocsr()
        right = np.concatenate([wanted, pulls[:, None] * placed])
        solved = [lsqr(system, right[:, k], atol=1e-10, btol=1e-10)[0] for k in range(3)]
        return np.stack(solved, axis=1)

    ours = partial(smooth_seams, surface, masses, placed, turns, WIDTH)
    seconds, peer = alternately(ours, plain, REPEATS)
    miss = np.abs(ours() - plain()).max()
    return row(
        "feature-preserved, smoothing of the seams",
        seconds,
        peer="scipy lsqr",
        peer_seconds=peer,
        target="no slower, with the same result",
        met=peer >= seconds and miss <= 1e-6,
        detail=f"largest difference of a coordinate {miss:.1e}",
    )

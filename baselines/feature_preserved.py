"""Feature-preserved form: near-rigid parts of the input, moved onto the least-squares MDS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    Interval,
    MethodInfo,
    Shape,
)

if TYPE_CHECKING:
    from baselines._kernels.arap import AsRigidAsPossible

MIRROR_MARGIN = 0.05
"""Share by which a mirror image must fit better.

The nearly flat parts of an open surface fit both equally well.
"""

#: Part of each vertex, shape (n,).
Parts = NDArray[np.int64]

PART_SIZE = 16
"""Minimum mean number of vertices per part: with a handful, "rigid" would be meaningless."""


@dataclass(frozen=True, kw_only=True)
class FeaturePreserved(CheckedParameters):
    r"""Feature-preserved canonical form (Lian, Godil and Xiao 2013).

    Least-squares MDS finds the pose but crumples the surface. Here near-rigid parts of the input,
    with rest positions p, move rigidly onto their MDS positions m:

    1. Farthest-point sampling spreads seeds over the surface. Each vertex joins the part of the
       seed that is nearest along the surface, and the seams shift so that the parts fit m better.
    2. Part c moves by the rigid motion that brings it and its adjacent vertices nearest to m,
       :math:`\min_{R_c, t_c} \sum_{i \in c} a_i \|R_c p_i + t_c - m_i\|^2`, and the parts then
       shift to meet at their seams.
    3. The seams are smoothed over a narrow band, outside which parts keep every detail.

    MDS cannot distinguish a pose from its mirror image: both images of m are tried, and the one
    that the parts fit better is kept. "Feature-preserved 3D canonical form", International Journal
    of Computer Vision 102. The source divides a closed surface by its protrusions; parts around
    spread seeds also cut limbs at their joints and work on any connected surface.

    Parameters
    ----------
    parts
        Number of parts, fewer on a surface with few vertices.
    rounds
        Maximum number of rounds in which seams shift.
    seam
        Width of the band in which a seam is smoothed, as a share of the square root of the area.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="feature-preserved",
        title="Feature-preserved",
        cite="lian2013feature",
        family="extended",
        summary=(
            "Moves nearly rigid parts onto the least-squares form as they are, and smooths "
            "their seams."
        ),
        departs=(
            "Parts grow around evenly spread seeds; the source cuts a closed surface at its "
            "protrusions. The number of parts and the width of smoothed seams are ours. Of the "
            "two mirror images, the one that the parts fit better is kept. The MDS form is that "
            "of Least Square MDS, a local minimum of the stress."
        ),
        needs=("pairs",),
    )

    parts: Annotated[int, Interval(1)] = 16
    rounds: Annotated[int, Interval(0)] = 10
    seam: Annotated[float, Interval(0, closed="neither")] = 0.03

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface with its parts in the pose of the least-squares MDS.

        The notes give the number of parts, the mean and largest edge strain, and whether the mirror
        image was kept.
        """
        from baselines.smacof import LeastSquaresMDS

        return self.move_onto(shape, LeastSquaresMDS().canonicalise(shape).vertices)

    def move_onto(self, shape: Shape, targets: FloatArray) -> CanonicalForm:
        """Move rigid parts of a surface onto targets, or onto their mirror image if it is nearer.

        Both are tried, because the sign of an embedding is arbitrary. The surface is divided into
        parts, which are fitted to the targets. The parts are then translated to close the gaps
        between them, and smoothed at their seams.

        Parameters
        ----------
        shape
            The surface.
        targets
            Target of each vertex, such as its position in an embedding, shape (n, 3).

        Returns
        -------
        CanonicalForm
            The moved surface. Its notes are the number of parts, its strains, and whether the
            mirror image was taken.
        """
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines._kernels.few_rows import farthest_points

        surface = AsRigidAsPossible.of(shape)
        masses = np.maximum(shape.mesh.vertex_areas, np.finfo(float).tiny)
        n_parts = max(1, min(self.parts, shape.mesh.n_vertices // PART_SIZE))
        seeds = farthest_points(shape, n_parts)
        # Each vertex belongs to the part of its nearest seed to begin with.
        nearest_seed = shape.geodesics()[seeds].argmin(axis=0)
        _, first_parts = np.unique(nearest_seed, return_inverse=True)
        mirror = np.array([-1.0, 1.0, 1.0])
        both_parts = []
        both_motions = []
        misses = []
        for aims in (targets, targets * mirror):
            parts = refit_parts(surface, aims, masses, first_parts, self.rounds)
            motions = rigid_motions(surface, aims, masses, parts)
            both_parts.append(parts)
            both_motions.append(motions)
            moved = _moved(surface, parts, motions)
            misses.append(masses @ ((moved - aims) ** 2).sum(axis=1))
        is_mirrored = misses[1] < (1 - MIRROR_MARGIN) * misses[0]
        chosen = int(is_mirrored)
        parts = both_parts[chosen]
        motions = close_gaps(surface, masses, parts, both_motions[chosen])
        vertices = smooth_seams(surface, masses, parts, motions, width=self.seam)
        notes = surface.strains(vertices)
        mirrored = "yes" if is_mirrored else "no"
        return shape.form(vertices, parts=len(motions.rotations), **notes, mirrored=mirrored)


class Motions(NamedTuple):
    """Rigid motions of k parts.

    A vertex p of part c moves to ``rotations[c] @ p + translations[c]``.

    Attributes
    ----------
    rotations
        Rotation matrices, shape (k, 3, 3).
    translations
        Shape (k, 3).
    """

    rotations: FloatArray
    translations: FloatArray


def _moved(surface: AsRigidAsPossible, parts: Parts, motions: Motions) -> FloatArray:
    """Return the vertices after the motions of their parts, shape (n, 3)."""
    turned = np.einsum("nab,nb->na", motions.rotations[parts], surface.rest)
    return np.asarray(turned + motions.translations[parts])


def rigid_motions(
    surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: Parts
) -> Motions:
    """Compute the rigid motion of each part that brings it nearest to its targets (Kabsch 1976).

    The neighbours of a part count as its own, so that neighbouring parts agree on their seam and
    not even a part of a single vertex can rotate freely.

    Parameters
    ----------
    surface
        The surface at rest, with the weights of its edges.
    targets
        Target of each vertex, shape (n, 3).
    masses
        Weight of each vertex, shape (n,).
    parts
        Part of each vertex, from 0, shape (n,).
    """
    from baselines._kernels.arap import nearest_rotations  # lazy

    of_parts = np.eye(int(parts.max()) + 1)[parts]
    weights = masses * ((of_parts + surface.weights @ of_parts).T > 0)
    weights /= weights.sum(axis=1, keepdims=True)
    centres = weights @ surface.rest
    goals = weights @ targets
    covariances = np.einsum("kn,na,nb->kab", weights, surface.rest, targets, optimize=True)
    rotations = nearest_rotations(covariances - centres[:, :, None] * goals[:, None, :])
    return Motions(rotations, goals - np.einsum("kab,kb->ka", rotations, centres))


def refit_parts(
    surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: Parts, rounds: int
) -> Parts:
    """Shift the seams between parts so that the rigid motions of the parts fit the targets better.

    In each round, every vertex at a seam joins the neighbouring part whose motion brings it nearest
    to its target. A part that would keep fewer than half of its initial vertices loses none in this
    round, and no part becomes empty.

    Parameters
    ----------
    surface
        The surface at rest, with the weights of its edges.
    targets
        Target of each vertex, shape (n, 3).
    masses
        Weight of each vertex, shape (n,).
    parts
        Part of each vertex, from 0, shape (n,).
    rounds
        Maximum number of rounds.

    Returns
    -------
    numpy.ndarray
        Part of each vertex afterwards, shape (n,).
    """
    graph = surface.weights
    vertices = np.arange(len(parts))
    start = np.repeat(vertices, np.diff(graph.indptr))
    end = graph.indices
    smallest_sizes = np.maximum(np.bincount(parts) // 2, 1)
    for _ in range(rounds):
        rotations, translations = rigid_motions(surface, targets, masses, parts)
        # Where each part would bring each vertex, and how far from its target: shape (parts, n).
        moved = np.einsum("kab,nb->kna", rotations, surface.rest) + translations[:, None]
        misses = ((moved - targets) ** 2).sum(axis=2)
        # A vertex can only join the part of a neighbour; other parts are infinitely far.
        offered = np.full(misses.shape, np.inf)
        offered[parts[end], start] = misses[parts[end], start]
        is_better = offered.min(axis=0) < misses[parts, vertices]
        changed = np.where(is_better, offered.argmin(axis=0), parts)
        is_too_small = np.bincount(changed, minlength=len(smallest_sizes)) < smallest_sizes
        while is_too_small.any():
            # All vertices of such a part stay in it. This may empty a part that they would have
            # joined, which is then treated alike.
            changed = np.where(is_too_small[parts], parts, changed)
            is_too_small = np.bincount(changed, minlength=len(smallest_sizes)) == 0
        if (changed == parts).all():
            break
        parts = changed
    return parts


def close_gaps(
    surface: AsRigidAsPossible, masses: FloatArray, parts: Parts, motions: Motions
) -> Motions:
    r"""Translate the parts, without rotation, so that they meet at their seams.

    With the edges (i, j) of the seams between parts c and d, of weights w, the rotations R and the
    given translations :math:`t^0`, and the share :math:`\alpha_c` of part c in the area, solve

    .. math:: \min_t \sum_c \alpha_c \|t_c - t^0_c\|^2
              + \sum_{ij} w_{ij} \| R_c p_i + t_c - R_d p_j - t_d - \tfrac12 (R_c + R_d)(p_i - p_j)
              \|^2 .

    With the middles :math:`m_{ij} = \tfrac12 (p_i + p_j)` of these edges, the second norm is that
    of :math:`t_c - t_d - g_{ij}`, :math:`g_{ij} = (R_d - R_c) m_{ij}`, and the translations solve
    the linear system, one equation for each part c,

    .. math:: \alpha_c t_c + \sum_{ij} w_{ij} (t_c - t_d)
              = \alpha_c t^0_c + \sum_{ij} w_{ij} g_{ij} ,

    where i runs over the vertices of c and j over their neighbours in other parts d.

    Parameters
    ----------
    surface
        The surface at rest, with positions p and edge weights w.
    masses
        Area of each vertex, shape (n,).
    parts
        Part of each vertex, shape (n,).
    motions
        Rigid motion of each part.

    Returns
    -------
    Motions
        The same rotations, and the translations t.
    """
    rotations, translations = motions
    graph = surface.weights
    start = np.repeat(np.arange(len(parts)), np.diff(graph.indptr))
    end = graph.indices
    is_seam = parts[start] != parts[end]  # each edge of a seam counts both ways
    start = start[is_seam]
    end = end[is_seam]
    weights = graph.data[is_seam]
    first = parts[start]
    second = parts[end]
    middles = (surface.rest[start] + surface.rest[end]) / 2
    gaps = np.einsum("eab,eb->ea", rotations[second] - rotations[first], middles)
    system = np.diag(np.bincount(parts, masses) / masses.sum())
    right_side = system @ translations
    np.add.at(system, (first, first), weights)
    np.add.at(system, (first, second), -weights)
    np.add.at(right_side, first, weights[:, None] * gaps)
    return Motions(rotations, np.asarray(np.linalg.solve(system, right_side)))


def smooth_seams(
    surface: AsRigidAsPossible,
    masses: FloatArray,
    parts: Parts,
    motions: Motions,
    *,
    width: float,
) -> FloatArray:
    r"""Move the parts of a surface, and smooth the seams between them in a band of width b.

    With the positions y that the motions give, find the positions x that minimise

    .. math:: \sum_{ij} w_{ij} \| (x_i - x_j) - \tfrac12 (R_i + R_j) (p_i - p_j) \|^2
              + \frac1{b^2} \sum_i m_i \| x_i - y_i \|^2 ,

    a screened Poisson equation: the perturbation by a seam decays as :math:`e^{-d/b}` with the
    distance d from it.

    Parameters
    ----------
    surface
        The surface at rest, with positions p and edge weights w.
    masses
        Area m of each vertex, shape (n,).
    parts
        Part of each vertex, shape (n,).
    motions
        Rigid motion of each part; the vertices of a part have its rotation R.
    width
        Width b of the band, as a share of the square root of the area.
    """
    pull = masses / (width**2 * masses.sum())
    moved = _moved(surface, parts, motions)
    load = surface.load(motions.rotations[parts])
    return surface.factorise(pull)(load + pull[:, None] * moved)

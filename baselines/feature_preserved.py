"""Feature-preserved form: near-rigid parts of the input, moved onto the least-squares MDS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

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
        """Move the parts onto positions of the vertices, shape (n, 3), or onto their mirror."""
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines._kernels.few_rows import farthest_points

        surface = AsRigidAsPossible.of(shape)
        masses = np.maximum(shape.mesh.vertex_areas, np.finfo(float).tiny)
        seeds = farthest_points(shape, max(1, min(self.parts, shape.mesh.n_vertices // PART_SIZE)))
        nearest = np.unique(shape.geodesics()[seeds].argmin(axis=0), return_inverse=True)[1]
        fits = []
        misses = []
        for image in (targets, targets * [-1.0, 1.0, 1.0]):
            parts = refit_parts(surface, image, masses, nearest, self.rounds)
            rotations, translations = rigid_motions(surface, image, masses, parts)
            fits.append((parts, rotations, translations))
            moved = _moved(surface, parts, rotations, translations)
            misses.append(masses @ ((moved - image) ** 2).sum(axis=1))
        is_mirrored = misses[1] < (1 - MIRROR_MARGIN) * misses[0]
        parts, rotations, translations = fits[int(is_mirrored)]
        translations = close_gaps(surface, masses, parts, rotations, translations)
        vertices = smooth_seams(surface, masses, parts, rotations, translations, self.seam)
        notes = surface.strains(vertices)
        mirrored = "yes" if is_mirrored else "no"
        return shape.form(vertices, parts=len(rotations), **notes, mirrored=mirrored)


def _moved(
    surface: AsRigidAsPossible, parts: Parts, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Return the vertices after the motions of their parts, shape (n, 3)."""
    return np.asarray(np.einsum("nab,nb->na", rotations[parts], surface.rest) + translations[parts])


def rigid_motions(
    surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: Parts
) -> tuple[FloatArray, FloatArray]:
    """Compute the rigid motion of each part that brings it nearest to its targets (Kabsch 1976).

    The neighbours of a part count as its own, so that neighbouring parts agree on their seam and
    not even a part of a single vertex can rotate freely.

    Returns
    -------
    rotations : numpy.ndarray
        Proper, shape (k, 3, 3).
    translations : numpy.ndarray
        Shape (k, 3): a vertex p of part c moves to ``rotations[c] @ p + translations[c]``.
    """
    from baselines._kernels.arap import nearest_rotations  # lazy

    of_parts = np.eye(int(parts.max()) + 1)[parts]
    weights = masses * ((of_parts + surface.weights @ of_parts).T > 0)
    weights /= weights.sum(axis=1, keepdims=True)
    centres = weights @ surface.rest
    goals = weights @ targets
    covariances = np.einsum("kn,na,nb->kab", weights, surface.rest, targets, optimize=True)
    rotations = nearest_rotations(covariances - centres[:, :, None] * goals[:, None, :])
    return rotations, goals - np.einsum("kab,kb->ka", rotations, centres)


def refit_parts(
    surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: Parts, rounds: int
) -> Parts:
    """Shift the seams, vertex by vertex, so that the parts fit the targets better.

    In each round every vertex at a seam joins the part of a neighbour whose rigid motion brings it
    nearest to its target. Vertices of a part that would keep fewer than half of its initial
    vertices stay, and no part becomes empty.
    """
    graph = surface.weights
    numbers = np.arange(len(parts))
    start = np.repeat(numbers, np.diff(graph.indptr))
    least = np.maximum(np.bincount(parts) // 2, 1)
    for _ in range(rounds):
        rotations, translations = rigid_motions(surface, targets, masses, parts)
        moved = np.einsum("kab,nb->kna", rotations, surface.rest) + translations[:, None]
        misses = ((moved - targets) ** 2).sum(axis=2)
        offered = np.full(misses.shape, np.inf)
        offered[parts[graph.indices], start] = misses[parts[graph.indices], start]
        changed = np.where(
            offered.min(axis=0) < misses[parts, numbers], offered.argmin(axis=0), parts
        )
        losing = np.bincount(changed, minlength=len(least)) < least
        while losing.any():  # returning vertices may empty the parts that they had joined
            changed = np.where(losing[parts], parts, changed)
            losing = np.bincount(changed, minlength=len(least)) == 0
        if (changed == parts).all():
            break
        parts = changed
    return parts


def close_gaps(
    surface: AsRigidAsPossible,
    masses: FloatArray,
    parts: Parts,
    rotations: FloatArray,
    translations: FloatArray,
) -> FloatArray:
    r"""Translate the parts, without rotation, so that they meet at their seams.

    With the edges (i, j) of the seams, of weights w, and the share :math:`\alpha_c` of part c in
    the area,

    .. math:: \min_t \sum_c \alpha_c \|t_c - t^0_c\|^2
              + \sum_{ij} w_{ij} \| R_c p_i + t_c - R_d p_j - t_d - \tfrac12 (R_c + R_d)(p_i - p_j)
              \|^2 .
    """
    graph = surface.weights
    start = np.repeat(np.arange(len(parts)), np.diff(graph.indptr))
    end = graph.indices
    seam = parts[start] != parts[end]  # each edge both ways
    start = start[seam]
    end = end[seam]
    weights = graph.data[seam]
    first = parts[start]
    second = parts[end]
    # The gap is R_c m + t_c - R_d m - t_d at the middle m of the edge.
    middles = (surface.rest[start] + surface.rest[end]) / 2
    gaps = np.einsum("eab,eb->ea", rotations[second] - rotations[first], middles)
    system = np.diag(np.bincount(parts, masses) / masses.sum())
    right = system @ translations
    np.add.at(system, (first, first), weights)
    np.add.at(system, (first, second), -weights)
    np.add.at(right, first, weights[:, None] * gaps)
    return np.asarray(np.linalg.solve(system, right))


def smooth_seams(
    surface: AsRigidAsPossible,
    masses: FloatArray,
    parts: Parts,
    rotations: FloatArray,
    translations: FloatArray,
    width: float,
) -> FloatArray:
    r"""Smooth the seams between placed parts, in a band of width b.

    The width is given as a share of the square root of the area.

    Finds the positions x that minimise

    .. math:: \sum_{ij} w_{ij} \| (x_i - x_j) - \tfrac12 (R_i + R_j) (p_i - p_j) \|^2
              + \frac1{b^2} \sum_i m_i \| x_i - y_i \|^2 ,

    a screened Poisson equation: the perturbation by a seam decays as :math:`e^{-d/b}` with the
    distance d from it.
    """
    pull = masses / (width**2 * masses.sum())
    placed = _moved(surface, parts, rotations, translations)
    return surface.factorise(pull)(surface.load(rotations[parts]) + pull[:, None] * placed)

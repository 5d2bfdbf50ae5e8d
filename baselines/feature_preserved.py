"""Feature-preserved form: near-rigid parts of the input, each moved rigidly onto the least-squares MDS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.orientation import vertex_areas
from benchmark.api.contracts import CanonicalForm, CheckedParameters, FloatArray, Interval, MethodInfo, Shape

if TYPE_CHECKING:
    from baselines._kernels.arap import AsRigidAsPossible

MIRROR_MARGIN = 0.05
"""Share by which a mirror image must fit better: the nearly flat parts of an open surface fit both equally well."""

PART_SIZE = 16
"""Minimum mean number of vertices per part: with a handful, "rigid" would be meaningless."""


@dataclass(frozen=True, kw_only=True)
class FeaturePreserved(CheckedParameters):
    r"""Feature-preserved canonical form (Lian, Godil and Xiao 2013).

    Least-squares MDS finds the pose but crumples the surface. Here near-rigid parts of the input, with rest positions
    p, move rigidly onto their MDS positions m:

    1. Farthest-point sampling spreads seeds over the surface. Each vertex joins the part of the seed that is nearest
       along the surface, and the seams shift so that the parts fit m better.
    2. Part c moves by the rigid motion that brings it and its adjacent vertices nearest to m,
       :math:`\min_{R_c, t_c} \sum_{i \in c} a_i \|R_c p_i + t_c - m_i\|^2`, and the parts then shift to meet at their
       seams (:func:`baselines._kernels.rigid_parts.close_gaps`).
    3. The seams are smoothed over a narrow band, outside which parts keep every detail
       (:func:`baselines._kernels.rigid_parts.smooth_seams`).

    MDS cannot distinguish a pose from its mirror image: both images of m are tried, and the one that the parts fit
    better is kept. "Feature-preserved 3D canonical form", International Journal of Computer Vision 102. The source
    divides a closed surface by its protrusions; parts around spread seeds also cut limbs at their joints and work on
    any connected surface.

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
        summary="near-rigid parts moved rigidly onto the least-squares form, seams smoothed",
        departs=(
            "Parts grow around spread seeds, where the source divides a closed surface by its protrusions; of both "
            "mirror images, that which the parts fit better is kept."
        ),
    )

    parts: Annotated[int, Interval(1)] = 16
    rounds: Annotated[int, Interval(0)] = 10
    seam: Annotated[float, Interval(0, closed="neither")] = 0.03

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface with its parts in the pose of the least-squares MDS.

        The notes give the number of parts, the mean and largest edge strain, the root-mean-square distance from the
        targets, and whether the mirror image of the MDS was kept.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices or no face, is in several pieces, or has too many vertices for all
            pairwise distances.
        """
        from baselines.least_squares_mds import LeastSquaresMDS

        require_vertices(shape)
        require_connected(shape)
        return self.move_onto(shape, LeastSquaresMDS().canonicalise(shape).vertices)

    def move_onto(self, shape: Shape, targets: FloatArray) -> CanonicalForm:
        """Move the parts of a surface onto given positions of its vertices or their mirror image.

        Parameters
        ----------
        shape
            The surface.
        targets
            One position per vertex, shape (n, 3), in units of the mesh and in any orientation.
        """
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines._kernels.rigid_parts import close_gaps, rigid_motions, smooth_seams

        surface = AsRigidAsPossible.of(shape)
        masses = np.maximum(vertex_areas(shape.mesh), np.finfo(float).tiny)
        seeds = self._around_seeds(shape)
        images = [targets, targets * [-1.0, 1.0, 1.0]]
        divided = [self._divided(surface, image, masses, seeds) for image in images]
        kept = int(divided[1][1] < (1 - MIRROR_MARGIN) * divided[0][1])
        parts = divided[kept][0]
        rotations, translations = rigid_motions(surface, images[kept], masses, parts)
        translations = close_gaps(surface, masses, parts, rotations, translations)
        placed = np.einsum("nab,nb->na", rotations[parts], surface.rest) + translations[parts]
        width = self.seam * float(np.sqrt(masses.sum()))
        vertices = smooth_seams(surface, masses, placed, rotations[parts], width)
        strains = surface.edge_strains(vertices)
        misses = ((vertices - images[kept]) ** 2).sum(axis=1)
        return shape.form(
            vertices,
            parts=len(rotations),
            mean_edge_strain=float(strains.mean()),
            largest_edge_strain=float(strains.max()),
            distance_from_targets=float(np.sqrt(masses @ misses / masses.sum())),
            mirrored="yes" if kept else "no",
        )

    def _around_seeds(self, shape: Shape) -> NDArray[np.int64]:
        """Return the part of each vertex before any seam shifts."""
        from baselines._kernels.rigid_parts import nearest_seed
        from baselines._kernels.sampling import farthest_points

        seeds = farthest_points(shape, max(1, min(self.parts, shape.mesh.n_vertices // PART_SIZE)))
        return nearest_seed(shape.geodesics()[seeds])

    def _divided(
        self, surface: AsRigidAsPossible, targets: FloatArray, masses: FloatArray, parts: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], float]:
        """Return the parts after their seams shifted, and the weighted sum of squared distances from the targets."""
        from baselines._kernels.rigid_parts import refit_parts, rigid_motions

        parts = refit_parts(surface, targets, masses, parts, self.rounds)
        rotations, translations = rigid_motions(surface, targets, masses, parts)
        moved = np.einsum("nab,nb->na", rotations[parts], surface.rest) + translations[parts]
        return parts, float(masses @ ((moved - targets) ** 2).sum(axis=1))

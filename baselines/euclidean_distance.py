"""Euclidean-distance-based form: a few points of the surface repel each other while edges keep their length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from benchmark.api.contracts import CanonicalForm, CheckedParameters, Interval, MethodInfo, Shape

APART = 0.1
"""Minimum distance between two tips, as a share of the square root of the area: more than between two fingers, less
than between two legs."""


@dataclass(frozen=True, kw_only=True)
class EuclideanDistance(CheckedParameters):
    r"""Variant of the Euclidean-distance-based canonical form (Pickup, Sun, Rosin and Martin 2015).

    A push drives a few points S of the surface apart in space, while the edges keep their lengths l in the input:

    .. math:: E(x) = \frac12 \sum_{ij \in \mathrm{edges}} (\|x_i - x_j\| - l_{ij})^2
              - \kappa \sum_{a < b \in S} \|x_a - x_b\| .

    It needs no geodesic distances, and the time of a step is proportional to the number of vertices. The steps are
    those of stress majorisation and share one factorisation of the graph Laplacian G:

    .. math:: G x \leftarrow \sum_{ij} \frac{l_{ij}}{\|x_i - x_j\|} (e_i - e_j)(x_i - x_j)
              + \kappa \sum_{ab} \frac{1}{\|x_a - x_b\|} (e_a - e_b)(x_a - x_b).

    None of them raises E. The push is :math:`\kappa = 4 \tau \bar l \sqrt n / |S|^2` with the mean edge length
    :math:`\bar l`, so that the pull across a limb and the strain of its edges depend neither on the number of points
    nor on the number of vertices. Final steps without a push restore the edge lengths. "Euclidean-distance-based
    canonical forms for non-rigid 3D shape retrieval", Pattern Recognition 48.

    Parameters
    ----------
    points
        ``"global"`` pushes farthest-point samples all over the surface; ``"local"`` pushes the tips of limbs, where the
        conformal factor is largest (Ben-Chen and Gotsman 2008), or the global points if there are fewer than two tips.
    count
        Maximum number of points.
    tension
        Strength :math:`\tau` of the push.
    iterations
        Number of steps with a push.
    settling
        Number of steps without a push.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="euclidean-distance",
        title="Euclidean distance, after Pickup et al.",
        cite="pickup2015euclidean",
        family="extended",
        summary="points of the surface pushed apart in space while edges keep their length",
        departs=(
            "Only the idea is the source's: energy, steps and strength of the push are ours, and the choice of points "
            "in the local variant is unconfirmed."
        ),
    )

    points: Literal["global", "local"] = "global"
    count: Annotated[int, Interval(2)] = 30
    tension: Annotated[float, Interval(0, closed="neither")] = 0.05
    iterations: Annotated[int, Interval(1)] = 150
    settling: Annotated[int, Interval(0)] = 50

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the stretched surface, centred at the origin.

        The notes give the number of points, the factor by which their mean distance grew, and the mean and largest edge
        strain.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than four vertices or no face, or is in several pieces.
        """
        from baselines._kernels.springs import Springs

        require_vertices(shape)
        require_connected(shape)
        chosen = self._points(shape)
        springs = Springs.of(shape.mesh)
        vertices = shape.mesh.vertices
        push = 4 * self.tension * float(springs.lengths.mean()) * np.sqrt(shape.mesh.n_vertices) / len(chosen) ** 2
        before = springs.spread(vertices, chosen)
        form = springs.relax(vertices, chosen, push, self.iterations)
        form = springs.relax(form, chosen, 0.0, self.settling)
        strains = springs.strains(form)
        return shape.form(
            form - springs.masses @ form,
            points=len(chosen),
            growth=springs.spread(form, chosen) / before,
            mean_edge_strain=float(strains.mean()),
            largest_edge_strain=float(strains.max()),
        )

    def _points(self, shape: Shape) -> list[int]:
        from baselines._kernels.conformal import tips
        from baselines._kernels.sampling import farthest_points

        points = tips(shape, self.count, APART) if self.points == "local" else []
        return points if len(points) > 1 else farthest_points(shape, self.count)

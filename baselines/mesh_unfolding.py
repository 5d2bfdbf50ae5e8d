"""Mesh unfolding: the vertices of the surface repel each other, without geodesic distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import CanonicalForm, CheckedParameters, Interval, MethodInfo, Shape


@dataclass(frozen=True, kw_only=True)
class MeshUnfolding(CheckedParameters):
    r"""Detail-preserving mesh unfolding (Sahillioğlu & Kavan 2016).

    All vertices repel each other while an elastic energy preserves the surface:

    .. math:: E(x) = -\sum_{i<j} a_i a_j \|x_i - x_j\| + \beta E_\mathrm{ARAP}(x; p)

    with vertex areas :math:`a` of sum 1 on a surface of unit area with rest positions :math:`p`. The stiffness
    :math:`\beta` doubles with each cascade: a soft surface spreads its limbs, a stiffer one restores its details. The
    cascades end as soon as the mean edge strain is at most ``strain_bound``. Without geodesic distances, a hand that
    touches a knee affects only the contact.

    The source repels by squared distances, which have no upper bound unless the surface is stiff enough; the distances
    used here give a bounded force at any stiffness. The source regularises with finite elements; the
    as-rigid-as-possible energy of Sorkine & Alexa (2007), co-rotated elements of a surface, handles closed and open
    surfaces alike.

    Parameters
    ----------
    first_stiffness
        Stiffness :math:`\beta` of the first cascade.
    iterations
        Number of steps of the first cascade, which unfolds the surface.
    later_iterations
        Number of steps of each later cascade. A few suffice to undo the stretch; with many, a stiff surface would bend
        back towards its rest pose.
    strain_bound
        Maximum mean edge strain of the result.
    max_cascades
        Maximum number of cascades. The notes show if the strain is still above the bound.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="mesh-unfolding",
        title="Mesh Unfolding",
        cite="sahillioglu2016unfolding",
        family="paper",
        summary="vertices pushed apart under elastic regularisation, no geodesics",
        departs=(
            "Vertices repel each other by distance, not by squared distance. An as-rigid-as-possible energy replaces "
            "finite elements. Stiffness and step sizes are ours."
        ),
        needs=("connected",),
    )

    first_stiffness: Annotated[float, Interval(0, closed="neither")] = 0.25
    iterations: Annotated[int, Interval(1)] = 60
    later_iterations: Annotated[int, Interval(1)] = 5
    strain_bound: Annotated[float, Interval(0)] = 0.05
    max_cascades: Annotated[int, Interval(1)] = 16

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the unfolded surface; notes are its edge strains, the number of cascades and the final stiffness."""
        from baselines._kernels.arap import AsRigidAsPossible
        from baselines._kernels.repulsion import PROXIMITY, relax

        areas = shape.mesh.vertex_areas
        unit, masses = float(np.sqrt(areas.sum())), areas / areas.sum()
        surface = AsRigidAsPossible.of(shape, unit)
        solve, stiffness, cascades = surface.factorise(PROXIMITY * masses), self.first_stiffness, 1
        positions = relax(surface, solve, masses, surface.rest, stiffness, self.iterations)
        while surface.strains(positions)["mean_edge_strain"] > self.strain_bound and cascades < self.max_cascades:
            stiffness, cascades = 2 * stiffness, cascades + 1
            positions = relax(surface, solve, masses, positions, stiffness, self.later_iterations)
        notes = surface.strains(positions)
        return shape.form(unit * positions, **notes, cascades=cascades, stiffness=stiffness)

"""Mesh unfolding: the vertices of the surface repel each other, without geodesic distances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numba import njit

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

#: Squared distance up to which points coincide, in squared units of the surface.
COINCIDENT_SQUARED = 1e-30

PROXIMITY = 1e-4
"""Diagonal of the global step, as a share of the stiffness.

Both energies are invariant under translation, so the system needs a hold; a weak hold of every
vertex at its current position keeps the descent monotone.
"""


@dataclass(frozen=True, kw_only=True)
class MeshUnfolding(CheckedParameters):
    r"""Detail-preserving mesh unfolding (Sahillioğlu & Kavan 2016).

    All vertices repel each other while an elastic energy preserves the surface:

    .. math:: E(x) = -\sum_{i<j} a_i a_j \|x_i - x_j\| + \beta E_\mathrm{ARAP}(x; p)

    with vertex areas :math:`a` of sum 1 on a surface of unit area with rest positions :math:`p`.
    The stiffness :math:`\beta` doubles with each cascade: a soft surface spreads its limbs, a
    stiffer one restores its details. The cascades end as soon as the mean edge strain is at most
    ``strain_bound``. It needs no geodesic distances, which are wrong where a hand touches a knee.

    The source repels by squared distances, which have no upper bound unless the surface is stiff
    enough; the distances used here give a bounded force at any stiffness. The source regularises
    with finite elements; the as-rigid-as-possible energy of Sorkine & Alexa (2007), co-rotated
    elements of a surface, handles closed and open surfaces alike.

    Parameters
    ----------
    first_stiffness
        Stiffness :math:`\beta` of the first cascade.
    iterations
        Number of steps of the first cascade, which unfolds the surface.
    later_iterations
        Number of steps of each later cascade. A few suffice to undo the stretch; with many, a stiff
        surface would bend back towards its rest pose.
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
        summary=(
            "Lets all points push each other apart while the surface resists stretching: limbs "
            "spread."
        ),
        departs=(
            "Vertices repel each other by distance, not by squared distance. An "
            "as-rigid-as-possible energy replaces finite elements. The first stiffness, the bound "
            "of the mean strain and the numbers of steps are ours."
        ),
        needs=("connected",),
    )

    first_stiffness: Annotated[float, Interval(0, closed="neither")] = 0.25
    iterations: Annotated[int, Interval(1)] = 60
    later_iterations: Annotated[int, Interval(1)] = 5
    strain_bound: Annotated[float, Interval(0)] = 0.05
    max_cascades: Annotated[int, Interval(1)] = 16

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the unfolded surface, whose vertices are as far apart as its stiffness allows.

        The surface is soft to begin with. Its stiffness doubles until its edges are strained by at
        most ``strain_bound``, or ``max_cascades`` is reached.

        Returns
        -------
        CanonicalForm
            Its notes are the edge strains, the number of cascades and the final stiffness.
        """
        from baselines._kernels.arap import AsRigidAsPossible

        areas = shape.mesh.vertex_areas
        unit = float(np.sqrt(areas.sum()))
        masses = areas / areas.sum()
        surface = AsRigidAsPossible.of(shape, unit)
        solve = surface.factorise(PROXIMITY * masses)
        stiffness = self.first_stiffness
        cascades = 1
        positions = relax(surface, solve, masses, surface.rest, stiffness, self.iterations)
        while (
            surface.strains(positions)["mean_edge_strain"] > self.strain_bound
            and cascades < self.max_cascades
        ):
            stiffness = 2 * stiffness
            cascades = cascades + 1
            positions = relax(surface, solve, masses, positions, stiffness, self.later_iterations)
        notes = surface.strains(positions)
        return shape.form(unit * positions, **notes, cascades=cascades, stiffness=stiffness)


def relax(
    surface: AsRigidAsPossible,
    solve: Callable[[FloatArray], FloatArray],
    masses: FloatArray,
    positions: FloatArray,
    stiffness: float,
    steps: int,
) -> FloatArray:
    r"""Let the vertices of a surface repel each other against its elastic energy.

    The energy is :math:`-\sum_{i<j} a_i a_j \|x_i - x_j\| + \beta E_\mathrm{ARAP}(x)`. Each step
    replaces the concave first term by its tangent and the rotations by the best ones, both upper
    bounds that touch the energy at the current positions, and minimises their sum exactly by one
    sparse solve: the energy never rises (majorisation; Hunter & Lange 2004). It is bounded below,
    since the repulsion grows linearly and the elastic energy quadratically.

    Parameters
    ----------
    surface
        Elastic energy and rest positions.
    solve
        Solves the system of the surface with ``PROXIMITY * masses`` added, which does not depend on
        the stiffness.
    masses
        Weight of each vertex in the repulsion, shape (n,), sum 1.
    positions
        Initial positions, shape (n, 3).
    stiffness
        Factor :math:`\beta` of the elastic energy, in the inverse unit of the positions.
    steps
        Number of steps.

    Returns
    -------
    numpy.ndarray
        Positions after the last step, shape (n, 3); the centroid under ``masses`` does not change.
    """
    centroid = masses @ positions
    for _ in range(steps):
        load = surface.load(surface.rotations(positions)) + repulsion(positions, masses) / (
            2 * stiffness
        )
        positions = solve(load + PROXIMITY * masses[:, None] * positions)
        positions += centroid - masses @ positions
    return positions


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"}, error_model="numpy")  # type: ignore[untyped-decorator]
def repulsion(positions: FloatArray, masses: FloatArray) -> FloatArray:
    r"""Return the gradient of the spread :math:`\sum_{i<j} a_i a_j \|x_i - x_j\|` of points.

    Parameters
    ----------
    positions
        Points x, shape (n, 3).
    masses
        Weights a, shape (n,).

    Returns
    -------
    numpy.ndarray
        Gradient by the positions, shape (n, 3); coincident points do not push each other.
    """
    # Every pair is visited once: it pushes both of its points, in opposite directions.
    x = positions[:, 0].copy()
    y = positions[:, 1].copy()
    z = positions[:, 2].copy()
    force_x = np.zeros_like(x)
    force_y = np.zeros_like(y)
    force_z = np.zeros_like(z)
    for i in range(len(masses)):
        sum_x = 0.0
        sum_y = 0.0
        sum_z = 0.0
        for j in range(i):
            dx = x[i] - x[j]
            dy = y[i] - y[j]
            dz = z[i] - z[j]
            squared = dx * dx + dy * dy + dz * dz
            # The inverse distance, 0 for coincident points. A root in single precision and one step
            # of Newton's method are faster than a root in double precision.
            guess = (
                np.float64(np.float32(1.0) / np.sqrt(np.float32(squared)))
                if squared > COINCIDENT_SQUARED
                else 0.0
            )
            push = masses[i] * masses[j] * guess * (1.5 - 0.5 * squared * guess * guess)
            sum_x = sum_x + push * dx
            sum_y = sum_y + push * dy
            sum_z = sum_z + push * dz
            force_x[j] = force_x[j] - push * dx
            force_y[j] = force_y[j] - push * dy
            force_z[j] = force_z[j] - push * dz
        force_x[i] += sum_x
        force_y[i] += sum_y
        force_z[i] += sum_z
    return np.stack((force_x, force_y, force_z), axis=1)

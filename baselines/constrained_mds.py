"""Constrained MDS: the input pulled towards its least-squares MDS pose, details preserved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

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


@dataclass(frozen=True, kw_only=True)
class ConstrainedMDS(CheckedParameters):
    r"""Deformation towards the MDS pose under a sparse shape regulariser (Sahillioğlu 2015).

    Multidimensional scaling finds the pose but crumples the surface. Here the input itself, with
    rest positions :math:`p`, moves towards the least-squares MDS positions :math:`m` of its
    vertices, while an as-rigid-as-possible energy preserves the details:

    .. math:: E(x) = E_\mathrm{ARAP}(x; p) + \lambda \sum_i a_i \|x_i - m_i\|^2

    with vertex areas :math:`a` of sum 1, so that :math:`\lambda` has no unit and does not depend on
    the sampling. Starting from :math:`x = p`, local steps (one rotation per cell) alternate with
    global steps (one sparse solve), and :math:`\lambda` rises geometrically in cascades, so that
    large parts move first and small ones later.

    MDS cannot distinguish a pose from its mirror image, and a surface pulled towards the wrong one
    turns inside out. Both images of :math:`m` are therefore aligned with :math:`p` by a proper
    rotation, and of both deformations the one with the lower energy :math:`E` is kept.

    Sahillioğlu deforms the enclosed solid; the surface energy used here also handles open surfaces.
    The abstract of the source speaks of "its MDS pose": a minimiser, not a step on the way to it.
    :math:`m` is the form of :class:`baselines.smacof.LeastSquaresMDS` with its defaults.

    Parameters
    ----------
    first_pull, last_pull
        Weight :math:`\lambda` of the targets in the first and the last cascade.
    cascades
        Number of values of :math:`\lambda`; with one, it is ``first_pull``.
    iterations
        Number of iterations per cascade, each of a local and a global step.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="constrained-mds",
        title="Constrained MDS",
        cite="sahillioglu2015constrained",
        family="paper",
        summary=(
            "Bends the shape towards its least-squares form, and keeps details such as ears and "
            "hands."
        ),
        departs=(
            "An as-rigid-as-possible energy of the surface replaces the source's deformation of a "
            "solid. The weights of the targets and the numbers of cascades and iterations are "
            "ours. Of the two mirror images, the one with lower energy is kept. The MDS pose is "
            "the form of Least Square MDS, a local minimum of the stress; the abstract of the "
            "source does not say which MDS it uses."
        ),
        needs=("pairs",),
    )

    first_pull: Annotated[float, Interval(0, closed="neither")] = 1.0
    last_pull: Annotated[float, Interval(0, closed="neither")] = 10.0
    cascades: Annotated[int, Interval(1)] = 5
    iterations: Annotated[int, Interval(1)] = 20

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the deformed surface.

        The notes give the mean and largest edge strain, the final energy and that of the rejected
        mirror image, both in squared units of the mesh, and whether the mirror image was kept.
        """
        from baselines.smacof import LeastSquaresMDS

        return self.deform_towards(shape, LeastSquaresMDS().canonicalise(shape).vertices)

    def deform_towards(self, shape: Shape, targets: FloatArray) -> CanonicalForm:
        """Deform a surface towards targets, or their mirror image if that takes less energy.

        Both are tried, because the sign of an embedding is arbitrary. The pull on the vertices
        changes step by step from ``first_pull`` to ``last_pull``.

        Parameters
        ----------
        shape
            The surface.
        targets
            Position towards which each vertex is drawn, shape (n, 3).

        Returns
        -------
        CanonicalForm
            The deformed surface. Its notes are its strains, its energy, the energy of the rejected
            deformation, and whether the mirror image was taken.
        """
        from baselines._kernels.arap import AsRigidAsPossible, aligned

        surface = AsRigidAsPossible.of(shape)
        areas = shape.mesh.vertex_areas
        mirror = np.array([-1.0, 1.0, 1.0])
        both_targets = [
            aligned(targets, shape.mesh.vertices, areas),
            aligned(targets * mirror, shape.mesh.vertices, areas),
        ]
        both_deformed = [surface.rest, surface.rest]
        # Alternate between the best rotations for given positions, and the best positions for given
        # rotations. The matrix of the second step depends on the pull alone.
        for strength in np.geomspace(self.first_pull, self.last_pull, self.cascades):
            pull = strength * areas / areas.sum()
            solve = surface.factorise(pull)
            for k, aims in enumerate(both_targets):
                for _ in range(self.iterations):
                    rotations = surface.rotations(both_deformed[k])
                    both_deformed[k] = solve(surface.load(rotations) + pull[:, None] * aims)
        energies = [
            _energy(surface, vertices, aims, pull)
            for vertices, aims in zip(both_deformed, both_targets, strict=True)
        ]
        is_mirrored = energies[1] < energies[0]
        chosen = int(is_mirrored)
        vertices = both_deformed[chosen]
        return shape.form(
            vertices,
            **surface.strains(vertices),
            energy=energies[chosen],
            rejected_energy=energies[1 - chosen],
            mirrored="yes" if is_mirrored else "no",
        )


def _energy(
    surface: AsRigidAsPossible, vertices: FloatArray, targets: FloatArray, pull: FloatArray
) -> float:
    """Return the elastic energy of a deformed surface, and that of the pull of its targets.

    Parameters
    ----------
    surface
        The surface at rest.
    vertices, targets
        Vertices of the deformed surface and their targets, shape (n, 3).
    pull
        Weight of the squared distance of each vertex from its target, shape (n,).
    """
    elastic: float = surface.energy(vertices, surface.rotations(vertices))
    attraction = float(pull @ ((vertices - targets) ** 2).sum(axis=1))
    return elastic + attraction

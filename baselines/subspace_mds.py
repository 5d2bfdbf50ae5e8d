"""Subspace MDS: least-squares MDS by smooth displacements of the surface, from few samples to more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
    MethodInfo,
    Shape,
)

NEGLIGIBLE = 1e-2
"""Combinations of functions whose size at the samples is below this share of the largest are left out. The samples do
not determine them, so a fit would scatter the vertices between the samples."""


@dataclass(frozen=True, kw_only=True)
class SubspaceMDS(CheckedParameters):
    r"""Subspace least-squares MDS (Boyarski, Bronstein and Bronstein 2017).

    The surface :math:`X_0` moves to :math:`X = X_0 + \Phi_p A` by displacements in the span of its first p
    Laplace-Beltrami eigenfunctions, so that a few samples s suffice to measure the stress
    :math:`\sum_{i<j \in s} (\|x_i - x_j\| - \delta_{ij})^2`. With the Guttman transform :math:`\tilde X_s` of the
    samples, stress majorisation in the span is

    .. math:: A \leftarrow (\Phi_s^\top J \Phi_s)^+ \Phi_s^\top J (\tilde X_s - X_{0,s}), \qquad
              X_s \leftarrow X_{0,s} + \Phi_s A,

    which moves the samples to the point of the span nearest to the transform and never raises their stress
    (:math:`J = I - 11^\top / q` removes translations). Few functions and samples determine the pose first; each finer
    level starts from the previous form. Details finer than the last eigenfunction remain those of the input. With all
    functions and samples it is plain majorisation from the mesh, ``least-squares-mds[algorithm=majorization]``.
    "Subspace least squares multidimensional scaling", SSVM 2017.

    Parameters
    ----------
    eigenfunctions
        Maximum number p of eigenfunctions on each level; the last one lies at a gap of the spectrum.
    oversampling
        Number of samples per eigenfunction on a level.
    max_iterations
        Maximum number of transforms on each level.
    rtol
        End a level when a transform lowers the stress by less than this fraction.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="subspace-mds",
        title="Subspace LS-MDS",
        cite="boyarski2017subspace",
        family="extended",
        summary="stress majorisation by smooth displacements, from few rows of geodesic distances",
        departs=(
            "A level ends at a gap of the spectrum, and combinations of eigenfunctions that the samples do not see "
            "stay out."
        ),
    )

    eigenfunctions: tuple[Annotated[int, Interval(10)], ...] = (50, 200)
    oversampling: Annotated[float, Interval(1)] = 2.0
    max_iterations: Annotated[int, Interval(1)] = 100
    rtol: Annotated[float, Interval(0, 1, closed="left")] = 1e-3
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the displaced surface, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than five vertices, no face, or several pieces.
        """
        from baselines._kernels.orientation import vertex_areas
        from baselines._kernels.sampling import farthest_points, stress_of_rows
        from baselines._kernels.spectral import clear_eigenpairs, clear_length

        require_vertices(shape, 5)
        require_connected(shape)
        values, functions = clear_eigenpairs(shape.laplacian(), max(self.eigenfunctions))
        samples = farthest_points(shape, self._samples(max(self.eigenfunctions)))
        rows = shape.geodesics_from(samples, self.solver)
        between = (rows[:, samples] + rows[:, samples].T) / 2
        points = shape.mesh.vertices
        iterations = 0
        for most in self.eigenfunctions:
            used = slice(self._samples(most))
            basis = functions[:, : clear_length(values, most)]
            displacement, steps = self._descend(basis, points, samples[used], between[used, used])
            points = points + displacement
            iterations += steps
        areas = vertex_areas(shape.mesh)
        points = points - areas @ points / areas.sum()
        return shape.form(
            points, samples=len(samples), iterations=iterations, stress_of_rows=stress_of_rows(points, samples, rows)
        )

    def _samples(self, eigenfunctions: int) -> int:
        return int(np.ceil(self.oversampling * (eigenfunctions + 1)))

    def _descend(
        self, basis: FloatArray, points: FloatArray, samples: list[int], distances: FloatArray
    ) -> tuple[FloatArray, int]:
        """Return the displacement of all vertices that lowers the samples' stress, and the number of transforms."""
        from baselines._kernels.smacof import StressProblem, attractions

        problem = StressProblem(distances, None)
        start = points[samples] - points[samples].mean(axis=0)
        seen = basis[samples] - basis[samples].mean(axis=0)
        span, sizes, mixture = np.linalg.svd(seen, full_matrices=False)
        kept = sizes > NEGLIGIBLE * sizes[0]
        span, mixture = span[:, kept], mixture[kept].T / sizes[kept]
        form = np.ascontiguousarray(start.T)
        sums = attractions(form, distances)
        course = [problem.stress(form, sums)]
        amounts = np.zeros((span.shape[1], 3))
        for _ in range(self.max_iterations):
            amounts = span.T @ (problem.solve(sums).T - start)
            form = np.ascontiguousarray((start + span @ amounts).T)
            sums = attractions(form, distances)
            course.append(problem.stress(form, sums))
            if course[-2] - course[-1] <= self.rtol * course[-2]:
                break
        return basis @ (mixture @ amounts), len(course) - 1

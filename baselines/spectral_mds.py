"""Classic scaling from a few rows of geodesic distances, continued by the lowest eigenfunctions of the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from baselines._kernels.checks import require_connected, require_vertices
from baselines._kernels.handedness import side_notes
from baselines._kernels.low_rank import low_rank_scaling
from baselines._kernels.orientation import vertex_areas
from baselines._kernels.spectral import clear_eigenpairs
from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    FloatArray,
    GeodesicSolver,
    Interval,
    MethodInfo,
    Shape,
)


@dataclass(frozen=True, kw_only=True)
class SpectralMDS(CheckedParameters):
    r"""Fast MDS (FMDS) in the Laplace-Beltrami basis.

    Squared geodesic distances are smooth on a surface, so a few eigenfunctions :math:`\Phi` (n x m) of its
    Laplace-Beltrami operator express them. From the values f at p farthest-point samples s the coefficients of a
    function are those of least Laplacian energy that still fit,

    .. math:: \min_a \; a^\top \Lambda^2 a + \frac\mu p \| \Phi_s a - f \|^2, \qquad
              a = C f, \quad C = (\tfrac p\mu \Lambda^2 + \Phi_s^\top \Phi_s)^{-1} \Phi_s^\top,

    on a surface of unit area. Continued both ways, the squared distances W between the samples become those of all
    pairs, and the classic scaling of

    .. math:: D \circ D \approx \Phi C W C^\top \Phi^\top

    is an eigenproblem of size m. Aflalo and Kimmel (2013), "Spectral multidimensional scaling"; Shamai, Zibulevsky and
    Kimmel (2018), "Efficient inter-geodesic distance computation and fast classical scaling".

    :class:`baselines.accelerated_mds.AcceleratedMDS` with ``variant=samples`` is the limit of all eigenfunctions and
    an exact fit: the same energy decides among all functions instead of the first m.

    Parameters
    ----------
    samples
        Number p of farthest-point samples.
    eigenfunctions
        Largest number m of eigenfunctions beside the constant; the basis ends at a gap of the spectrum.
    fidelity
        Weight :math:`\mu` of the fit against the smoothness.
    solver
        Geodesic solver, see :meth:`benchmark.api.contracts.Shape.geodesics`.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="spectral-mds",
        title="Spectral MDS",
        cite="shamai2018fast",
        family="extended",
        summary="classic scaling from few rows of distances in the Laplace-Beltrami basis (FMDS)",
        departs=(
            "Solved in a few eigenfunctions, where the authors' released code solves over all vertices and averages "
            "the product of interpolation and rows with its transpose. Signs of axes and the side of the mirror follow "
            "a rule of ours."
        ),
    )

    samples: Annotated[int, Interval(4)] = 50
    eigenfunctions: Annotated[int, Interval(10)] = 100
    fidelity: Annotated[float, Interval(0, closed="neither")] = 1e8
    solver: GeodesicSolver = "default"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the classic scaling of the continued distances, centred at the origin.

        Raises
        ------
        UnsupportedShape
            If the shape has fewer than five vertices, no face, or several pieces.
        """
        from baselines._kernels.sampling import farthest_points, squares_between, stress_of_rows

        require_vertices(shape, 5)
        require_connected(shape)
        samples = farthest_points(shape, self.samples)
        rows = shape.geodesics_from(samples, self.solver)
        basis, coefficients = self._continuation(shape, samples)
        coupling = coefficients @ squares_between(samples, rows) @ coefficients.T
        points = low_rank_scaling(shape.mesh, basis, coupling)
        return shape.form(
            points,
            samples=len(samples),
            eigenfunctions=basis.shape[1] - 1,
            stress_of_rows=stress_of_rows(points, samples, rows),
            **side_notes(points, vertex_areas(shape.mesh)),
        )

    def _continuation(self, shape: Shape, samples: list[int]) -> tuple[FloatArray, FloatArray]:
        """The basis, shape (n, m + 1), and the matrix C from values at the samples to coefficients in it."""
        laplacian = shape.laplacian()
        area = laplacian.mass.sum()
        values, functions = clear_eigenpairs(laplacian, self.eigenfunctions)
        basis = np.hstack([np.ones((len(functions), 1)), np.sqrt(area) * functions])
        energies = np.append(0.0, area * values) ** 2
        at_samples = basis[samples]
        system = at_samples.T @ at_samples + np.diag(len(samples) / self.fidelity * energies)
        return basis, np.linalg.solve(system, at_samples.T)

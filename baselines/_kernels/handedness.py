"""One rule for the mirror image that an embedding of distances leaves open.

A method that sees distances alone cannot tell a surface from its mirror image, and most creatures look the same in a
mirror. Let s be the map of such a body onto itself that exchanges left and right. Distances are the same after it, so
that a form Y of them is turned or mirrored onto itself by s. Where it is turned, as a propeller is, a rule that
compares the form with the input, and answers the opposite for a mirrored input, gives opposite answers for (X, Y) and
for the same pair after s, if the pose is symmetric: it is 0 there, and near it hangs on the pose. So the side is
chosen by the form itself: a left kick and a right kick, which have the same distances, then have the same form.

What remains are proper rotations: half a turn about an axis is one of the 24 turns over which the scorer compares.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from baselines._kernels.orientation import canonical_signs, settled_axes, vertex_areas
from benchmark.api.contracts import FloatArray, Mesh

Side = Literal["moment", "off"]

NEGLIGIBLE = 1e-6
"""Below it a form is its own mirror image, up to rounding errors, and is left as it is."""

DOUBTFUL = 0.02
"""Below it a note says so, and nothing else changes: a jitter of 1e-6 or another triangulation may turn the side."""


def handedness(points: FloatArray, weights: FloatArray) -> float:
    r"""Return how clearly a form differs from its mirror image, and which of the two it is.

    In coordinates (x, y, z) along the principal axes, the longest first and z making the frame right-handed, it is

    .. math:: \sum_i w_i x_i y_i z_i \Big/ \sum_i w_i |x_i y_i z_i| .

    The product does not change when two axes are turned round, so that the value depends on neither position, rotation
    nor size, and changes its sign in a mirror. It is 0 for what is symmetric about a principal plane. It is in doubt
    where it is near 0, and where two principal variances nearly tie.

    Parameters
    ----------
    points
        Positions, shape (n, 3).
    weights
        Weight of each, usually its area, shape (n,).

    Returns
    -------
    float
        From -1 to 1.
    """
    shares = weights / weights.sum()
    centred = points - shares @ points
    _, axes = np.linalg.eigh((centred * shares[:, None]).T @ centred)
    along = centred @ axes[:, ::-1]
    products = along.prod(axis=1) * np.sign(np.linalg.det(axes[:, ::-1]))
    size = float(shares @ np.abs(products))
    return float(shares @ products) / size if size > 0 else 0.0


def right_handed(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the form or its mirror image: that of positive :func:`handedness`.

    Parameters
    ----------
    points, weights
        As of :func:`handedness`. The last axis is the one that is turned round.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    return points * [1.0, 1.0, -1.0] if handedness(points, weights) < -NEGLIGIBLE else points


def oriented(
    mesh: Mesh,
    points: FloatArray,
    eigenvalues: FloatArray | None = None,
    *,
    areas: FloatArray | None = None,
    side: Side = "moment",
) -> FloatArray:
    """Settle what an embedding leaves open: axes of equal eigenvalues, signs, and the side of the mirror.

    Parameters
    ----------
    mesh
        The surface.
    points
        Positions along the axes, shape (n, 3).
    eigenvalues
        Of the axes, shape (3,), where equal ones leave axes open.
    areas
        Of the vertices, shape (n,); those of the mesh by default.
    side
        ``"moment"``: see :func:`right_handed`; ``"off"``: the side that the signs of the axes happen to give.
    """
    if eigenvalues is not None:
        points = settled_axes(points, eigenvalues, mesh.vertices)
    areas = vertex_areas(mesh) if areas is None else areas
    points = points * canonical_signs(points, areas, mesh.vertices)
    return right_handed(points, areas) if side == "moment" else points


def side_notes(points: FloatArray, weights: FloatArray) -> dict[str, float]:
    """Return the notes of a form on its side: ``handedness``, and ``side_in_doubt``, 1 where that is near 0, else 0."""
    found = handedness(points, weights)
    return {"handedness": found, "side_in_doubt": float(abs(found) < DOUBTFUL)}

"""Spherical Harmonics: energies of the surface on concentric shells, which no rotation changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial.distance import pdist, squareform

from benchmark.api import FloatArray, Interval, Mesh
from benchmark.api.scoring import ScorerInfo, SignatureArrays
from benchmark.errors import InvalidMesh

#: Triangles are split into four until there are at least this many.
FEWEST_TRIANGLES = 4000

#: Radius to which the mean distance from the centroid is scaled; the outermost shell has radius 1.
MEAN_RADIUS = 0.5

#: Distances are rounded to multiples of this, so that forms that differ by rounding alone tie.
RESOLUTION = 2.0**-30

#: Quadrature of degree 4 on the triangle [Dunavant 1985]: barycentric coordinates (1 - 2 a, a, a)
#: in every order, and their weights.
RULE = ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322))


@dataclass(frozen=True, kw_only=True)
class SphericalHarmonics:
    """Energies of spherical harmonics on the shells of a form, compared by Euclidean distance.

    The area of the form is shared among shells around its centroid. The part in each shell is a
    function on the sphere, whose energy in each degree of the spherical harmonics does not depend
    on the rotation of the form. Unlike the source, which rasterises the surface into voxels, this
    integrates over the triangles; area beyond the outermost shell counts towards that shell.

    Parameters
    ----------
    n_shells
        Number of shells, of radii 1/n, 2/n, ..., 1.
    n_degrees
        Number of degrees of the harmonics, from 0.

    References
    ----------
    Kazhdan, Funkhouser, Rusinkiewicz, "Rotation invariant spherical harmonic representation of 3D
    shape descriptors", Symposium on Geometry Processing 2003.
    """

    info: ClassVar[ScorerInfo] = ScorerInfo(
        name="spherical-harmonics",
        title="Spherical Harmonics",
        summary="energies of spherical harmonics on concentric shells, invariant under rotation",
    )

    n_shells: Annotated[int, Interval(2, 256)] = 32
    n_degrees: Annotated[int, Interval(1, 64)] = 16

    def signature(self, form: Mesh) -> SignatureArrays:
        """Return the energies by shell and degree: ``energies``, shape (n_shells, n_degrees).

        Raises
        ------
        InvalidMesh
            If the form has no area or no extent.
        """
        points, weights = sample_surface(form)
        centred = points - weights @ points
        radii = np.linalg.norm(centred, axis=1)
        mean = float(weights @ radii)
        if not mean > 1e-12 * np.abs(form.vertices).max():
            raise InvalidMesh("the form has zero extent", "check the method: all vertices coincide")
        directions = centred / np.maximum(radii, 1e-12 * mean)[:, None]
        shells = _on_shells(radii * (MEAN_RADIUS / mean), weights, self.n_shells)
        return {"energies": energies(directions, shells, self.n_degrees)}

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> FloatArray:
        """Return the Euclidean distances of all pairs, shape (N, N); ``draw`` has no effect."""
        distances = squareform(pdist([arrays["energies"].ravel() for arrays in signatures]))
        return np.asarray(np.round(distances / RESOLUTION) * RESOLUTION)


def sample_surface(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Return points of the surface, shape (k, 3), and their shares of its area, shape (k,).

    Raises
    ------
    InvalidMesh
        If the form has no area.
    """
    corners, areas = mesh.vertices[mesh.faces], mesh.face_areas
    if not areas.sum() > 0:
        raise InvalidMesh(
            "the form has no area", "return the triangles of the input with the new positions"
        )
    while len(corners) < FEWEST_TRIANGLES:
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab))
        corners = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
        areas = np.tile(areas / 4, 4)
    barycentric = np.array(
        [np.roll([1 - 2 * a, a, a], place) for a, _ in RULE for place in range(3)]
    )
    weights = np.repeat([weight for _, weight in RULE], 3)[:, None] * areas / areas.sum()
    return np.einsum("qk,ikj->qij", barycentric, corners).reshape(
        -1, 3
    ), weights.ravel() / weights.sum()


def _on_shells(radii: FloatArray, weights: FloatArray, n_shells: int) -> csr_array:
    """Return the weight of each point in each shell, shape (n_shells, k), shared by two shells."""
    place = np.clip(radii * n_shells - 1, 0, n_shells - 1)
    lower = np.minimum(place.astype(np.int64), n_shells - 2)
    share = place - lower
    rows, columns = np.concatenate([lower, lower + 1]), np.tile(np.arange(len(radii)), 2)
    values = np.concatenate([weights * (1 - share), weights * share])
    return csr_array((values, (rows, columns)), shape=(n_shells, len(radii)))


def energies(directions: FloatArray, shells: csr_array, n_degrees: int) -> FloatArray:
    """Return the energies of measures on the sphere in each degree, shape (n, n_degrees).

    Parameters
    ----------
    directions
        Unit vectors, shape (k, 3).
    shells
        Weight of each direction in each measure, shape (n, k).
    n_degrees
        Number of degrees, from 0.
    """
    squares = np.zeros((shells.shape[0], n_degrees))
    for order, degree, values in _harmonics(directions, n_degrees):
        squares[:, degree] += (1 if order == 0 else 2) * np.abs(shells @ values) ** 2
    return np.sqrt(squares)


def _harmonics(
    directions: FloatArray, n_degrees: int
) -> Iterator[tuple[int, int, NDArray[np.complex128]]]:
    """Yield order, degree and values of the orthonormal harmonics of orders from 0.

    Negative orders mirror them.

    For a fixed order, the Legendre functions of higher degree follow by their recurrence in z.
    """
    x, y, z = directions.T
    around = np.full(len(directions), 0.5 / np.sqrt(np.pi), dtype=np.complex128)
    for order in range(n_degrees):
        if order:
            around = around * (-np.sqrt((2 * order + 1) / (2 * order)) * (x + 1j * y))
        before, now = np.zeros(len(z)), np.ones(len(z))
        yield order, order, around
        for degree in range(order + 1, n_degrees):
            below = degree**2 - order**2
            rise = np.sqrt((4 * degree**2 - 1) / below)
            fall = np.sqrt(
                (2 * degree + 1) * ((degree - 1) ** 2 - order**2) / ((2 * degree - 3) * below)
            )
            before, now = now, rise * z * now - fall * before
            yield order, degree, around * now

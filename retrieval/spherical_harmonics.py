"""Energies of spherical harmonics on concentric shells: a rotation-invariant signature without pose normalisation.

The surface is divided among shells around its centroid. The part in each shell is a function on the sphere, whose
energy in each degree of the spherical harmonics does not depend on the rotation of the form. There is no rendering,
random draw or matching, so no step is shared with CM-BOF.

References
----------
Kazhdan, Funkhouser, Rusinkiewicz, "Rotation invariant spherical harmonic representation of 3D shape descriptors",
Symposium on Geometry Processing 2003.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial.distance import cdist, pdist, squareform

from benchmark.api.parameters import Interval
from benchmark.api.scoring import ScorerInfo, SignatureArrays
from benchmark.errors import InvalidMesh
from benchmark.geometry.mesh import Mesh

__all__ = ["SphericalHarmonics", "energies", "sample_surface"]

Points = NDArray[np.float64]

#: Minimum number of triangles; with fewer, all are repeatedly split into four. A count is the same on every machine.
FEWEST_TRIANGLES = 4000

#: Radius to which the mean distance from the centroid is scaled; the outermost shell has radius 1.
MEAN_RADIUS = 0.5

#: Distances are rounded to multiples of this, so that forms that differ only by rounding tie on every machine.
RESOLUTION = 2.0**-30

#: Quadrature of degree 4 on the triangle: barycentric coordinates (1 - 2 a, a, a) in every order, and their weights.
#: Dunavant, "High degree efficient symmetrical Gaussian quadrature rules for the triangle", 1985, table II.
_RULE = ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322))


@dataclass(frozen=True, kw_only=True)
class SphericalHarmonics:
    """Energies of spherical harmonics on the shells of a form, compared by Euclidean distance.

    The original rasterises the surface into a grid of 64 x 64 x 64 voxels. Here the area itself is integrated, so that
    the signature is as invariant as the arithmetic allows, and area beyond the outermost shell counts towards that
    shell instead of being cut off.

    Parameters
    ----------
    n_shells
        Number of shells, of radii 1/n, 2/n, ..., 1.
    n_degrees
        Number of degrees of the harmonics, from 0.

    References
    ----------
    Kazhdan, Funkhouser, Rusinkiewicz 2003, section 4: 32 shells, 16 degrees.
    """

    info: ClassVar[ScorerInfo] = ScorerInfo(
        name="spherical-harmonics",
        title="Spherical harmonics",
        cite="kazhdan2003rotation",
        summary="energies of spherical harmonics on concentric shells, invariant under rotation",
    )

    n_shells: Annotated[int, Interval(1, 256)] = 32
    n_degrees: Annotated[int, Interval(1, 64)] = 16

    def signature(self, form: Mesh) -> SignatureArrays:
        """Compute the energies by shell and degree: ``energies``, shape (n_shells, n_degrees).

        Raises
        ------
        InvalidMesh
            If the form has no triangles or no extent.
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

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """Return the Euclidean distances of all pairs of signatures, shape (N, N); ``draw`` has no effect."""
        return _rounded(squareform(pdist(_as_rows(signatures))))

    def codebook(self, signatures: Iterable[SignatureArrays], draw: int) -> SignatureArrays:
        """Return an empty codebook: signatures are compared directly."""
        return {}

    def encode(self, signature: SignatureArrays, codebook: SignatureArrays) -> SignatureArrays:
        """Return the signature unchanged."""
        return signature

    def match(self, rows: Sequence[SignatureArrays], columns: Sequence[SignatureArrays]) -> NDArray[np.float64]:
        """Return the Euclidean distances of each of M signatures to each of N others, shape (M, N)."""
        return _rounded(cdist(_as_rows(rows), _as_rows(columns)))


def _as_rows(signatures: Sequence[SignatureArrays]) -> Points:
    return np.array([arrays["energies"].ravel() for arrays in signatures])


def _rounded(distances: Points) -> Points:
    return np.asarray(np.round(distances / RESOLUTION) * RESOLUTION)


def sample_surface(mesh: Mesh) -> tuple[Points, Points]:
    """Sample the surface by points, weighted by their shares of its area.

    Returns
    -------
    points
        Shape (k, 3), six per triangle, or per quarter, sixteenth ... if there are few triangles.
    weights
        Shape (k,), sum 1.

    Raises
    ------
    InvalidMesh
        If the form has no area.
    """
    corners = mesh.vertices[mesh.faces]
    areas = mesh.face_areas
    total = float(areas.sum())
    if not (mesh.n_faces and total > 0):
        raise InvalidMesh("the form has no area", "return the triangles of the input with the new positions")
    while len(corners) < FEWEST_TRIANGLES:
        a, b, c = (corners[:, k] for k in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab))
        corners = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
        areas = np.tile(areas / 4, 4)
    points, weights = [], []
    for share, weight in _RULE:
        for place in range(3):
            barycentric = np.full(3, share)
            barycentric[place] = 1 - 2 * share
            points.append(np.einsum("k,ikj->ij", barycentric, corners))
            weights.append(weight * areas)
    joined = np.concatenate(weights)
    return np.concatenate(points), joined / joined.sum()


def _on_shells(radii: Points, weights: Points, n_shells: int) -> csr_array:
    """Return the weight of each point in each shell, shape (n_shells, k): the two nearest share it, without jumps."""
    place = np.clip(radii * n_shells - 1, 0, n_shells - 1)
    lower = np.minimum(place.astype(np.int64), max(n_shells - 2, 0))
    upper = np.minimum(lower + 1, n_shells - 1)
    share = place - lower
    numbers = np.arange(len(radii))
    rows, columns = np.concatenate([lower, upper]), np.concatenate([numbers, numbers])
    values = np.concatenate([weights * (1 - share), weights * share])
    return csr_array((values, (rows, columns)), shape=(n_shells, len(radii)))


def energies(directions: Points, shells: csr_array, n_degrees: int) -> Points:
    """Compute the energies of measures on the sphere in each degree of the spherical harmonics.

    Parameters
    ----------
    directions
        Unit vectors, shape (k, 3).
    shells
        Weight of each direction in each measure, shape (n, k).
    n_degrees
        Number of degrees, from 0.

    Returns
    -------
    numpy.ndarray
        Shape (n, n_degrees): the norm of the coefficients of orthonormal harmonics of that degree.
    """
    squares = np.zeros((shells.shape[0], n_degrees))
    for order, degree, values in _harmonics(directions, n_degrees):
        coefficients = shells @ values
        squares[:, degree] += (1 if order == 0 else 2) * (coefficients.real**2 + coefficients.imag**2)
    return np.asarray(np.sqrt(squares))


def _harmonics(directions: Points, n_degrees: int) -> Iterator[tuple[int, int, NDArray[np.complex128]]]:
    """Yield the orthonormal harmonics of all orders from 0: order, degree, values; negative orders mirror them.

    They need neither angles nor functions of the system library: only powers of x + iy, and in z the recurrence of the
    Legendre functions for a fixed order.
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
            fall = np.sqrt((2 * degree + 1) * ((degree - 1) ** 2 - order**2) / ((2 * degree - 3) * below))
            before, now = now, rise * z * now - fall * before
            yield order, degree, around * now

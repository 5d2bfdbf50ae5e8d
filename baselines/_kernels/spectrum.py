"""The lowest eigenvalues and eigenfunctions of a surface after the constant function."""

from __future__ import annotations

from benchmark.api.contracts import FloatArray, Shape, UnsupportedShape

#: If the second eigenvalue times the area is below this, only triangles without area join parts of
#: the surface. Bodies have about 3 to 25, and a neck of a thousandth of the width still has some
#: hundredths.
DETACHED = 1e-9


def spectrum(shape: Shape, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest eigenvalues and eigenfunctions of the Laplacian of a connected surface.

    The constant function, whose eigenvalue is 0, is left out.

    Parameters
    ----------
    shape
        The surface.
    count
        Number of eigenvalues, without that of the constant function.

    Returns
    -------
    values : numpy.ndarray
        Ascending, shape (count,), in inverse squared units of the shape.
    functions : numpy.ndarray
        Orthonormal in area, shape (n, count).

    Raises
    ------
    UnsupportedShape
        If the second eigenvalue of the Laplacian is zero, or the shape has too few vertices.
    """
    from benchmark.geometry.laplacian import eigenpairs

    laplacian = shape.laplacian()
    values, functions = eigenpairs(laplacian, count + 1)
    # Each piece of a surface has an eigenvalue 0. The product with the area has no unit.
    if values[1] * laplacian.mass.sum() < DETACHED:
        raise UnsupportedShape(
            f"{shape.identifier}: the second eigenvalue of the Laplacian is zero, because only "
            "triangles without area join parts of the surface",
            "merge vertices at the same position, or remesh the surface",
        )
    return values[1:], functions[:, 1:]

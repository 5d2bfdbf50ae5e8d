"""MATLAB files of TOSCA: a struct ``surface`` with X, Y, Z and triangles TRIV, counted from 1."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from benchmark.files import check_expansion
from benchmark.formats.ascii import whole_numbers
from benchmark.formats.base import Format, MeshArrays


def read(data: bytes, _: Path) -> MeshArrays:
    """Return the vertices and the triangles, counted from 1, of a MATLAB file.

    Parameters
    ----------
    data
        Bytes of the file, which holds a struct ``surface`` with the coordinates X, Y and Z of the
        vertices, and their numbers in three columns TRIV.

    Raises
    ------
    ValueError
        If it holds no such struct, or is of MATLAB 7.3.
    """
    from scipy.io import loadmat

    check_expansion(data)
    try:
        content = loadmat(io.BytesIO(data), variable_names=["surface"])
    except NotImplementedError as error:
        raise ValueError("it is a MATLAB 7.3 file; save it with '-v7'") from error
    surface = content.get("surface", np.empty(0))
    names = ("X", "Y", "Z", "TRIV")
    if surface.size != 1 or not set(names) <= set(surface.dtype.names or ()):
        raise ValueError("it has no struct 'surface' with X, Y, Z and TRIV")
    fields = {name: np.asarray(surface.flat[0][name]) for name in names}
    are_numbers = all(field.dtype.kind in "iuf" for field in fields.values())
    if not are_numbers or fields["TRIV"].shape[1:] != (3,):
        raise ValueError("X, Y and Z are no real numbers, or TRIV has not three columns")
    if len({fields[axis].size for axis in "XYZ"}) > 1:
        raise ValueError("X, Y and Z differ in length")
    # MATLAB counts down columns first.
    columns = [fields[axis].ravel(order="F") for axis in "XYZ"]
    vertices = np.stack(columns, axis=1).astype(np.float64)
    return vertices, whole_numbers(fields["TRIV"].astype(np.float64))


FORMAT = Format(
    module=__name__,
    extensions=(".mat",),
    first_vertex=1,
    read=read,
    preference=4,
)

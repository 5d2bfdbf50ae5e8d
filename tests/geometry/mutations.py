"""Small valid mesh files of every format."""

from __future__ import annotations

import io
import struct

import numpy as np
from scipy.io import savemat

from benchmark.geometry.mesh import Mesh


def valid_files(mesh: Mesh) -> dict[str, bytes]:
    """The mesh in every format and encoding that is read; the key is a file name. Triangles of a ``.vert`` lie beside.

    Written by hand rather than by the suite, so that writer and reader cannot err together.
    """
    points, faces = mesh.vertices.tolist(), mesh.faces.tolist()
    rows = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points)
    facets = mesh.vertices[mesh.faces].astype("<f4")
    ascii_facets = "".join(
        "facet normal 0 0 1\n outer loop\n"
        + "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners)
        + " endloop\nendfacet\n"
        for corners in facets.astype(np.float64).tolist()
    )
    columns = {axis: mesh.vertices[:, [at]] for at, axis in enumerate("XYZ")} | {"TRIV": mesh.faces + 1.0}
    return {
        "a.off": f"OFF\n{len(points)} {len(faces)} 0\n{rows}".encode()
        + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces).encode(),
        "a.obj": "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points).encode()
        + "".join(f"f {a + 1}//{a + 1} {b + 1}//{b + 1} {c + 1}//{c + 1}\n" for a, b, c in faces).encode(),
        "ascii.ply": ply_header("ascii", len(points), len(faces))
        + rows.encode()
        + "".join(f"7 3 {a} {b} {c}\n" for a, b, c in faces).encode(),
        **{
            f"{name}.ply": ply_header(f"binary_{name}_endian", len(points), len(faces))
            + mesh.vertices.astype(f"{order}f8").tobytes()
            + b"".join(struct.pack(f"{order}BB3i", 7, 3, *corners) for corners in faces)
            for name, order in (("little", "<"), ("big", ">"))
        },
        "ascii.stl": f"solid a\n{ascii_facets}endsolid a\n".encode(),
        "binary.stl": b"binary".ljust(80)
        + struct.pack("<I", len(faces))
        + b"".join(struct.pack("<3f", 0, 0, 1) + corners.tobytes() + b"\0\0" for corners in facets),
        "plain.mat": mat(columns, compressed=False),
        "packed.mat": mat(columns, compressed=True),
        "a.vert": rows.encode(),
        "a.tri": "".join(f"{a + 1} {b + 1} {c + 1}\n" for a, b, c in faces).encode(),
    }


def ply_header(encoding: str, n_vertices: int, n_faces: int) -> bytes:
    """Header of doubles and of faces with a flag before their corners."""
    return (
        f"ply\nformat {encoding} 1.0\nelement vertex {n_vertices}\nproperty double x\nproperty double y\n"
        f"property double z\nelement face {n_faces}\nproperty uchar flag\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()


def mat(fields: dict[str, np.ndarray], *, compressed: bool) -> bytes:
    """A MATLAB file with the struct ``surface``."""
    stream = io.BytesIO()
    savemat(stream, {"surface": fields}, do_compression=compressed)
    # The header tells the date, which must not tell one run of a test from another.
    return b"MATLAB 5.0 MAT-file".ljust(116) + stream.getvalue()[116:]

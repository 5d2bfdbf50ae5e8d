"""Small valid mesh files of every format, and damaged copies: what disks, networks and exporters do to files."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator

import numpy as np
from scipy.io import savemat

from benchmark.geometry.mesh import Mesh

#: Words that damage puts in place of others, and that a reader must not take for numbers of a mesh.
WORDS = (
    *(b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1_0", b"0x10", b"1.5", b"1e5", b"4294967296", b"--", b"\x00"),
    *(
        b"9" * 30,
        b"9" * 5000,
        "٣".encode(),
        b"\xff\xfe",
        b"list",
        b"ply",
        b"OFF",
        b"end_header",
        b"vertex",
        b"endfacet",
    ),
)


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


def mutations(content: bytes, count: int, seed: int = 0) -> Iterator[bytes]:
    """Damaged copies of a file, the same ones for the same seed.

    Bytes flip, blocks are lost, repeated, zeroed or moved, the end is cut off, words become others, and numbers in the
    first lines (the counts) grow.
    """
    random = np.random.default_rng([seed, len(content)])
    for _ in range(count):
        damaged = content
        for _ in range(int(random.integers(1, 4))):
            damaged = _DAMAGES[int(random.integers(len(_DAMAGES)))](damaged, random)
        yield damaged


def _span(content: bytes, random: np.random.Generator) -> tuple[int, int]:
    start = int(random.integers(len(content) + 1))
    return start, min(len(content), start + int(2 ** random.uniform(0, 8)))


def _flip(content: bytes, random: np.random.Generator) -> bytes:
    if not content:
        return content
    changed = bytearray(content)
    # The head, where the counts stand, is damaged as often as all the rest.
    reach = min(len(content), 200) if random.random() < 0.5 else len(content)
    changed[int(random.integers(reach))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _cut_off(content: bytes, random: np.random.Generator) -> bytes:
    return content[: int(random.integers(len(content) + 1))]


def _lose(content: bytes, random: np.random.Generator) -> bytes:
    start, end = _span(content, random)
    return content[:start] + content[end:]


def _repeat(content: bytes, random: np.random.Generator) -> bytes:
    start, end = _span(content, random)
    return content[:end] + content[start:end] * int(random.integers(1, 4)) + content[end:]


def _zero(content: bytes, random: np.random.Generator) -> bytes:
    start, end = _span(content, random)
    return content[:start] + bytes(end - start) + content[end:]


def _move(content: bytes, random: np.random.Generator) -> bytes:
    start, end = _span(content, random)
    rest = content[:start] + content[end:]
    at = int(random.integers(len(rest) + 1))
    return rest[:at] + content[start:end] + rest[at:]


def _reword(content: bytes, random: np.random.Generator) -> bytes:
    words = content.split(b" ")
    reach = min(len(words), 12) if random.random() < 0.5 else len(words)
    words[int(random.integers(reach))] = WORDS[int(random.integers(len(WORDS)))]
    return b" ".join(words)


def _grow(content: bytes, random: np.random.Generator) -> bytes:
    """Append digits to a number among the first bytes, as far as there is one."""
    at = int(random.integers(min(len(content), 200) + 1))
    digits = next((place for place in range(at, min(len(content), 400)) if content[place : place + 1].isdigit()), at)
    return content[:digits] + b"9" * int(random.integers(1, 12)) + content[digits:]


_DAMAGES = (_flip, _flip, _cut_off, _lose, _repeat, _zero, _move, _reword, _reword, _grow)

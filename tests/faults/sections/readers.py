"""Mesh files with random damage: the readers refuse them by name, or read a mesh that is whole."""

from __future__ import annotations

import random
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.faults.cases import Border, Case
from tests.faults.scene import OK, Scene

#: Seconds of one case, and cases a format.
_SECONDS, _CASES = 4.0, 2

#: Memory that a reader may take for a file of a few kilobytes, above what the process has, in bytes.
_MEMORY = 2**30

#: Seconds that a reader may take for such a file.
_SLOW = 5.0

FORMATS = (".off", ".obj", ".ply", ".stl", ".mat", ".vert")

#: Words that mean something to some reader.
_WORDS = (
    b"OFF", b"v ", b"f ", b"end_header", b"element face 99999999999\n", b"element vertex -1\n", b"nan", b"inf",
    b"1e999", b"-1", b"0", b"99999999999999999999", b"\n", b"\r", b"\0", b" ", b"#", b"/", b"\\\n", b"\xff", b"1.5",
    b"solid", b"property list uchar int vertex_indices\n", b"binary_big_endian", b"endfacet", b"surface", b"\x0e\0\0\0",
)  # fmt: skip


def cases() -> list[Case]:
    """Cases of some seconds each."""
    names = [f"readers/{suffix[1:]}-{number}" for suffix in FORMATS for number in range(_CASES)]
    return [Case(name, _try) for name in names]


def _try(scene: Scene) -> None:
    suffix = "." + scene.case.name.partition("/")[2].partition("-")[0]
    done = scene.command(
        suffix, scene.random.randrange(2**31), _SECONDS, codes=(OK,), target=f"{__name__}:damage_and_read"
    )
    *crossings, count = done.output.splitlines() or ["0"]
    for said in crossings:
        scene.cross(Border.SILENCE, said)
    scene.outcome.tried = int(count) if count.isdecimal() else 1


def damage_and_read() -> None:
    """Read damaged files for some seconds, a program of its own; prints a line for each that goes wrong, and a count.

    Arguments: the extension, a seed, the seconds.
    """
    from benchmark.errors import ShapeError
    from benchmark.geometry.io import read_mesh

    suffix, draw, seconds = sys.argv[1], random.Random(int(sys.argv[2])), float(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY + _memory(), resource.RLIM_INFINITY))
    whole = _whole(suffix)
    deadline, count = time.monotonic() + seconds, 0
    told: set[str] = set()

    def tell(kind: str, said: str) -> None:
        if kind not in told:  # once is enough to mend it
            told.add(kind)
            print(f"{kind}: {said}")

    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"shape{suffix}"
        while time.monotonic() < deadline:
            contents = {part: _damaged(content, draw) for part, content in whole.items()}
            for part, content in contents.items():
                path.with_suffix(part).write_bytes(content)
            begun = time.monotonic()
            try:
                mesh = read_mesh(path)
                if not np.isfinite(mesh.vertices).all() or (
                    mesh.faces.size and not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices)
                ):
                    tell("a mesh that is not whole", _short(contents))
            except ShapeError as error:
                if not error.mend or (str(path) not in str(error) and path.name not in str(error)):
                    print(f"neither file nor mend in {str(error)!r:.200}")
            except BaseException as error:
                tell(type(error).__name__, f"{str(error)!r:.100} for {_short(contents)}")
            if (taken := time.monotonic() - begun) > _SLOW:
                tell("slow", f"{taken:.0f} s for {_short(contents)}")
            count += 1
    print(count)


def _short(contents: dict[str, bytes]) -> str:
    return f"{contents!r:.300}"


def _memory() -> int:
    """Data of this process, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmData:"))


def _damaged(content: bytes, draw: random.Random) -> bytes:
    """A few random changes."""
    changes: list[Callable[[bytes], bytes]] = [
        lambda c: c[: draw.randrange(len(c) + 1)],
        lambda c: _with(c, draw, bytes([draw.randrange(256)])),
        lambda c: _with(c, draw, draw.choice(_WORDS)),
        lambda c: _without(c, draw),
        lambda c: c + c[draw.randrange(len(c) + 1) :],
        lambda c: draw.randbytes(draw.randrange(200)),
    ]
    for _ in range(draw.choice((1, 1, 2, 5))):
        content = draw.choices(changes, (2, 6, 6, 3, 1, 0.2))[0](content)
    return content


def _with(content: bytes, draw: random.Random, part: bytes) -> bytes:
    """The content with some bytes written over others, or between them."""
    place = draw.randrange(len(content) + 1)
    return content[:place] + part + content[place + draw.choice((0, len(part))) :]


def _without(content: bytes, draw: random.Random) -> bytes:
    place = draw.randrange(len(content) + 1)
    return content[:place] + content[place + draw.randrange(1, 20) :]


def _whole(suffix: str) -> dict[str, bytes]:
    """Files of a small mesh by extension."""
    from io import BytesIO

    from scipy.io import savemat

    from benchmark.geometry.io import write_mesh
    from tests.toy import rod

    mesh = rod(0.1, 0.5, rings=3, sides=4)
    if suffix == ".vert":
        rows = (b"\n".join(b" ".join(b"%r" % x for x in row) for row in mesh.vertices.tolist()), mesh.faces + 1)
        return {".vert": rows[0], ".tri": "\n".join(" ".join(map(str, row)) for row in rows[1].tolist()).encode()}
    if suffix == ".mat":
        file = BytesIO()
        x, y, z = mesh.vertices.T
        savemat(file, {"surface": {"X": x, "Y": y, "Z": z, "TRIV": mesh.faces + 1}})
        return {suffix: file.getvalue()}
    if suffix == ".stl":
        corners = mesh.vertices[mesh.faces].astype("<f4")
        triangles = b"".join(bytes(12) + corner.tobytes() + bytes(2) for corner in corners)
        return {suffix: bytes(80) + len(corners).to_bytes(4, "little") + triangles}
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"shape{suffix}"
        write_mesh(path, mesh)
        return {suffix: path.read_bytes()}

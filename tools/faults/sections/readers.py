"""Mesh files with random damage: the readers refuse them by name, or read a mesh that is whole."""

from __future__ import annotations

import random
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tools.faults.cases import Border, Case
from tools.faults.scene import OK, Scene

#: Seconds of one case, and cases a format.
_SECONDS, _CASES = 2.0, 4

#: Memory that a reader may take for a file of a few kilobytes, above what the process has, in bytes.
_MEMORY = 2**30

#: Seconds that a reader may take for such a file.
_SLOW = 5.0

FORMATS = (".off", ".obj", ".ply", ".stl", ".mat", ".vert")


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
        if kind not in told:  # once is enough to correct it
            told.add(kind)
            print(f"{kind}: {said}")

    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"shape{suffix}"
        while time.monotonic() < deadline:
            contents = {part: _damaged(content, draw) for part, content in draw.choice(whole).items()}
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
                if not error.hint or not any(path.with_suffix(part).name in str(error) for part in contents):
                    tell("neither file nor hint", f"{str(error)!r:.200}")
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
    from tests.geometry.mutations import mutations

    return next(mutations(content, 1, seed=draw.randrange(2**31)))


def _whole(suffix: str) -> list[dict[str, bytes]]:
    """A small mesh in every encoding of a format, each as its files by extension."""
    from tests.geometry.mutations import valid_files
    from tests.toy import rod

    files = valid_files(rod(0.1, 0.5, rings=3, sides=4))
    if suffix == ".vert":  # its triangles lie beside
        return [{Path(name).suffix: files[name] for name in ("a.vert", "a.tri")}]
    return [{suffix: content} for name, content in files.items() if name.endswith(suffix)]

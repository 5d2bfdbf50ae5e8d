"""Small shapes for tests, rods of two builds bent by several angles, and a disk that is full."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmark.geometry.mesh import Mesh
from tests.behaviour import suite

RADII = {"thin": 0.06, "thick": 0.18}


def rod(radius: float, bend: float, rings: int = 24, sides: int = 12) -> Mesh:
    """Closed rod of length 1, thicker towards one end, bent into an arc of the given angle in radians."""
    return Mesh(*suite.rod(radius, bend, rings, sides))


def write_off(path: Path, mesh: Mesh) -> None:
    """Write an OFF file without the code under test."""
    lines = ["OFF", f"{mesh.n_vertices} {mesh.n_faces} 0"]
    lines += [" ".join(repr(float(x)) for x in vertex) for vertex in mesh.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def write_rods(folder: Path, bends: tuple[float, ...] = (0.0, 1.2, 2.4)) -> Path:
    """A data set of two classes in a few poses each, the class in the file name."""
    for name, radius in RADII.items():
        for number, bend in enumerate(bends):
            write_off(folder / f"{name}{number}.off", rod(radius, bend))
    return folder


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Make writing fail as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

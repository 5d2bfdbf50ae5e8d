"""Small shapes for tests, rods of two builds bent by several angles, and a disk that is full."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmark.geometry.mesh import Mesh

RADII = {"thin": 0.06, "thick": 0.18}


def rod(radius: float, bend: float, rings: int = 24, sides: int = 12) -> Mesh:
    """Closed rod of length 1 bent into an arc of the given angle in radians; ends closed by a point each."""
    along = np.linspace(0, 1, rings)
    if bend:
        centre = np.column_stack([np.sin(bend * along) / bend, np.zeros(rings), (1 - np.cos(bend * along)) / bend])
    else:
        centre = np.column_stack([along, np.zeros(rings), np.zeros(rings)])
    tangent = np.column_stack([np.cos(bend * along), np.zeros(rings), np.sin(bend * along)])
    normal = np.column_stack([-tangent[:, 2], np.zeros(rings), tangent[:, 0]])
    angle = np.arange(sides) * 2 * np.pi / sides
    # A club rather than a cylinder, so that no two ends look alike.
    width = radius * (1 + 0.6 * along)
    ring = width[:, None, None] * (
        np.cos(angle)[None, :, None] * normal[:, None] + np.sin(angle)[None, :, None] * [0, 1, 0]
    )
    vertices = np.concatenate(
        [(centre[:, None] + ring).reshape(-1, 3), centre[[0, -1]] - [[radius / 2, 0, 0], [0, 0, 0]]]
    )
    faces = []
    for i in range(rings - 1):
        for j in range(sides):
            a, b = i * sides + j, i * sides + (j + 1) % sides
            faces += [(a, b, a + sides), (b, b + sides, a + sides)]
    first, last = rings * sides, rings * sides + 1
    for j in range(sides):
        faces.append((first, (j + 1) % sides, j))
        faces.append((last, (rings - 1) * sides + j, (rings - 1) * sides + (j + 1) % sides))
    return Mesh(vertices, np.array(faces))


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

"""Small shapes for tests, rods of two builds bent by several angles; a disk that is full; and
patience.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmark.geometry.mesh import Mesh

#: The scorer with few and small images, for tests that scores do not matter to.
SMALL_SCORER = "cm-bof[image_size=64,subdivisions=0]"

#: Seconds after which a test gives up on a process that hangs; a busy machine needs long for what
#: takes no time on an idle one.
PATIENCE = 250.0

RADII = {"thin": 0.06, "thick": 0.18}


def rod(radius: float, bend: float, rings: int = 24, sides: int = 12) -> Mesh:
    """Closed rod of length 1, thicker towards one end, bent into an arc of the given angle in
    radians.
    """
    along = np.linspace(0, 1, rings)
    zero = np.zeros(rings)
    x, z = (
        (np.sin(bend * along) / bend, (1 - np.cos(bend * along)) / bend) if bend else (along, zero)
    )
    centre = np.column_stack([x, zero, z])
    across = np.column_stack([-np.sin(bend * along), zero, np.cos(bend * along)])
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(angle)[None, :, None] * across[:, None] + np.sin(angle)[None, :, None] * [0, 1, 0]
    tube = centre[:, None] + (radius * (1 + 0.6 * along))[:, None, None] * ring
    vertices = np.concatenate([tube.reshape(-1, 3), centre[:1] - [radius / 2, 0, 0], centre[-1:]])
    index = np.arange(rings * sides).reshape(rings, sides)
    a, b, c, d = (
        part.ravel()
        for part in (index[:-1], np.roll(index[:-1], -1, 1), index[1:], np.roll(index[1:], -1, 1))
    )
    first, last = np.full(sides, rings * sides), np.full(sides, rings * sides + 1)
    caps = [(first, np.roll(index[0], -1), index[0]), (last, index[-1], np.roll(index[-1], -1))]
    return Mesh(
        vertices,
        np.concatenate(
            [np.stack(corners, 1)[:, ::-1] for corners in [(a, b, c), (b, d, c), *caps]]
        ),
    )


def write_off(path: Path, mesh: Mesh) -> None:
    """Write an OFF file without the code under test."""
    lines = ["OFF", f"{mesh.n_vertices} {mesh.n_faces} 0"]
    lines += [" ".join(repr(float(x)) for x in vertex) for vertex in mesh.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def write_rods(
    folder: Path,
    bends: Sequence[float] = (0.0, 1.2, 2.4),
    rings: int = 24,
    sides: int = 12,
    radii: Mapping[str, float] = RADII,
) -> Path:
    """A data set of a few classes in a few poses each, the class in the file name."""
    for name, radius in radii.items():
        for number, bend in enumerate(bends):
            write_off(folder / f"{name}{number}.off", rod(radius, bend, rings, sides))
    return folder


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Make writing fail as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    no_bytecode = (
        patch.dict(os.environ, PYTHONDONTWRITEBYTECODE="1"),
        patch.object(sys, "dont_write_bytecode", True),
    )
    try:
        with (
            no_bytecode[0],
            no_bytecode[1],
        ):  # Python would leave compiled modules of the suite cut off
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def wait_for(condition: Callable[[], Any], seconds: float = PATIENCE) -> Any:
    """Return what a condition gives once it holds."""
    until = time.monotonic() + seconds
    while not (found := condition()):
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.02)
    return found

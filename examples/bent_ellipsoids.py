"""Bent Ellipsoids, a data set: ellipsoids of a few proportions, each bent by several angles.

python bent_ellipsoids.py DIR
python -m benchmark run -d DIR -m classic-mds -m gps
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh

#: Half the two widths of each class; half the length is 1.
WIDTHS = {"flat": (0.12, 0.4), "round": (0.2, 0.2), "thick": (0.4, 0.35)}

#: Bends in radians per unit of length: the poses.
BENDS = (0.3, 0.8, 1.3, 1.8)


def bent_ellipsoid(widths: tuple[float, float], bend: float) -> trimesh.Trimesh:
    """Return a mesh; bending keeps distances along the middle, as a joint does."""
    sphere = trimesh.creation.icosphere(subdivisions=3)
    x, y, along = (sphere.vertices * [*widths, 1.0]).T
    radius = 1 / bend - x
    bent = np.stack(
        [1 / bend - radius * np.cos(bend * along), y, radius * np.sin(bend * along)], axis=1
    )
    return trimesh.Trimesh(bent, sphere.faces, process=False)


def write(folder: Path) -> None:
    """Write a mesh for each class and pose: flat0.off is of class flat, in pose 0."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, widths in WIDTHS.items():
        for pose, bend in enumerate(BENDS):
            bent_ellipsoid(widths, bend).export(folder / f"{name}{pose}.off")


if __name__ == "__main__":
    write(Path(sys.argv[1]))

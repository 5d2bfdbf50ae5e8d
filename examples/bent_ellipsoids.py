"""Bent Ellipsoids: ellipsoids of a few proportions, each bent like a banana by several angles."""

from __future__ import annotations

import numpy as np
import trimesh

from benchmark.api import Entry, Mesh, ShapeSet

#: Half the two widths of each class; half the length is 1.
WIDTHS = {"flat": (0.12, 0.4), "round": (0.2, 0.2), "thick": (0.4, 0.35)}

#: Bends in radians per unit of length: the poses.
BENDS = (0.3, 0.8, 1.3, 1.8)


def bent_ellipsoid(entry: Entry) -> Mesh:
    """Return the mesh of a shape; bending keeps distances along the middle, as a joint does."""
    sphere = trimesh.creation.icosphere(subdivisions=3)
    x, y, along = (sphere.vertices * [*WIDTHS[entry.subject], 1.0]).T
    bend = BENDS[int(entry.pose)]
    radius = 1 / bend - x
    bent = np.stack([1 / bend - radius * np.cos(bend * along), y, radius * np.sin(bend * along)], axis=1)
    return Mesh(bent, sphere.faces)


#: Each shape has a name of its own, a class that has to be found again, and a pose that must not matter.
BENT_ELLIPSOIDS = ShapeSet(
    name="bent-ellipsoids",
    title="Bent Ellipsoids",
    summary="bent ellipsoids, 3 classes x 4 poses",
    shapes=tuple(Entry(f"{name}{pose}", name, str(pose)) for name in WIDTHS for pose in range(len(BENDS))),
    load=bent_ellipsoid,
)

"""Bent Ellipsoids: ellipsoids of a few proportions, each bent like a banana by several angles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import trimesh

from benchmark.api import DatasetInfo, Entry, Mesh

#: Half the two widths of each class; half the length is 1.
WIDTHS = {"flat": (0.12, 0.4), "round": (0.2, 0.2), "thick": (0.4, 0.35)}

#: Bends in radians per unit of length: the poses.
BENDS = (0.3, 0.8, 1.3, 1.8)


@dataclass(frozen=True, kw_only=True)
class BentEllipsoids:
    """Three classes in four poses; bending keeps distances along the middle, as a joint does."""

    info: ClassVar[DatasetInfo] = DatasetInfo(
        name="bent-ellipsoids",
        title="Bent Ellipsoids",
        summary="bent ellipsoids, 3 classes x 4 poses",
    )

    def entries(self) -> Iterable[Entry]:
        """List the shapes by class; ``subject`` is what has to be found again, ``pose`` what must not matter."""
        for subject in WIDTHS:
            for number in range(len(BENDS)):
                yield Entry(identifier=f"{subject}{number}", subject=subject, pose=str(number))

    def load(self, entry: Entry) -> Mesh:
        """Make the mesh of a shape; leave this out if every entry has the ``path`` of a mesh file."""
        sphere = trimesh.creation.icosphere(subdivisions=3)
        x, y, along = (sphere.vertices * [*WIDTHS[entry.subject], 1.0]).T
        bend = BENDS[int(entry.pose)]
        radius = 1 / bend - x
        bent = np.stack([1 / bend - radius * np.cos(bend * along), y, radius * np.sin(bend * along)], axis=1)
        return Mesh(bent, sphere.faces)

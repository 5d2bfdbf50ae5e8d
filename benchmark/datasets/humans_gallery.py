"""Any number of generated humans, for galleries larger than published sets: ``humans[subjects=500,poses=20]``.

The bodies are drawn like training bodies, but with another seed and at a distance from the subjects of ``humans`` only.
All bodies have the same poses, those of :mod:`benchmark.datasets.humans`. A larger gallery begins with the bodies of
the smaller one.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np

from benchmark.api.parameters import assignments
from benchmark.datasets import humans
from benchmark.datasets.base import Entry
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import Subject, new_subject
from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh

#: Seed of the bodies; the seed of training bodies is 0.
_SEED = 1

#: Maximum number of subjects.
_MOST = 100_000


@dataclass(frozen=True)
class HumansGallery:
    """Any number of bodies in some of the poses of the generated humans.

    Parameters
    ----------
    subjects
        Number of bodies.
    poses
        Number of poses per body, the first ones of the list.

    Raises
    ------
    ConfigurationError
        If a number is out of range.
    """

    subjects: int
    poses: int = len(POSES)
    stand_in_for: str = ""
    half_width: float = 1.45  # some bodies are taller than those of ``humans``

    def __post_init__(self) -> None:
        for name, value, least, most in (("subjects", self.subjects, 2, _MOST), ("poses", self.poses, 2, len(POSES))):
            if not least <= value <= most:
                raise ConfigurationError(f"humans cannot have {value} {name}", f"choose {least} to {most}")

    @classmethod
    def parse(cls, name: str) -> HumansGallery:
        """Create a gallery from a name such as ``"humans[subjects=500,poses=20]"``.

        Raises
        ------
        ConfigurationError
            If a parameter is unknown or not a number, or ``subjects`` is missing.
        """
        inside = name.partition("[")[2].rpartition("]")[0]
        counts = assignments(inside)
        if "subjects" not in counts or counts.keys() - {"subjects", "poses"}:
            raise ConfigurationError(f"'{name}' is no gallery", "write humans[subjects=N,poses=M]")
        for parameter, text in counts.items():
            if not re.fullmatch("[0-9]{1,9}", text):
                raise ConfigurationError(f"{parameter} of '{name}' is no number", "write humans[subjects=N,poses=M]")
        return cls(int(counts["subjects"]), int(counts.get("poses", len(POSES))))

    @property
    def name(self) -> str:
        """Name on the command line, in canonical form."""
        return f"humans[subjects={self.subjects},poses={self.poses}]"

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"generated humans, {self.subjects} subjects x {self.poses} poses"

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Shapes by subject, then by pose."""
        return _entries(self.subjects, self.poses)

    def load(self, entry: Entry) -> Mesh:
        """Generate the mesh of a shape; see :func:`benchmark.datasets.humans.human_meshes`."""
        return humans.human_mesh(_body(entry.subject), POSES[entry.pose])

    def recipe(self, entry: Entry) -> str:
        """Return the body parameters and joint angles."""
        return humans.recipe(_body(entry.subject), POSES[entry.pose])

    def camera(self, entry: Entry) -> Camera:
        """Return the front view."""
        return FRONT


@functools.cache
def _entries(subjects: int, poses: int) -> tuple[Entry, ...]:
    chosen = list(POSES)[:poses]
    return tuple(Entry(f"body-{n}_{pose}", f"body-{n}", pose) for n in range(subjects) for pose in chosen)


@functools.lru_cache(maxsize=_MOST)
def _body(subject: str) -> Subject:
    index = int(subject.removeprefix("body-"))
    return new_subject(np.random.default_rng([_SEED, index, 0]), sets=("humans",))

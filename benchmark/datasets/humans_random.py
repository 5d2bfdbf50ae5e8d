"""Generated humans drawn at random, three times fifteen: what the choice of the subjects of ``humans`` is worth.

Those of ``humans`` were searched for large differences in geodesic distances, which is what the methods measure. These
follow from a rule and a seed (:func:`benchmark.datasets.human_subjects.random_subjects`) that were committed before
anything was run on them; poses and all else are those of :mod:`benchmark.datasets.humans`.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.datasets import humans
from benchmark.datasets.base import Entry
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import RANDOM_SUBJECTS, Subject
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh


@dataclass(frozen=True)
class HumansRandom:
    """The data set of 15 random subjects in 20 poses.

    Parameters
    ----------
    draw
        Which of the draws.
    """

    draw: int = 0
    stand_in_for: str = ""
    half_width: float = humans.Humans.half_width

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"humans-random[draw={self.draw}]"

    @property
    def title(self) -> str:
        """Name in captions."""
        return "humans drawn at random"

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The 300 shapes, by subject, then by pose; no two draws share a name, for no two share a subject."""
        subjects = [f"{name}-of-draw-{self.draw}" for name in RANDOM_SUBJECTS[self.draw]]
        return tuple(Entry(f"{subject}_{pose}", subject, pose) for subject in subjects for pose in POSES)

    def load(self, entry: Entry) -> Mesh:
        """Make the mesh of one shape; see :func:`benchmark.datasets.humans.human_meshes`."""
        return humans.human_mesh(self._body(entry), POSES[entry.pose])

    def recipe(self, entry: Entry) -> str:
        """Name the values of the body and the angles of its joints."""
        return humans.recipe(self._body(entry), POSES[entry.pose])

    def _body(self, entry: Entry) -> Subject:
        return RANDOM_SUBJECTS[self.draw][entry.subject.partition("-of-")[0]]

    def camera(self, entry: Entry) -> Camera:
        """Look at the front."""
        return FRONT

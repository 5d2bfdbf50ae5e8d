"""Three draws of fifteen random humans, to assess the effect of the choice of subjects in ``humans``.

The subjects of ``humans`` were selected for large differences in geodesic distances, which the methods measure. These
subjects follow from a rule and a seed (:func:`benchmark.datasets.human_subjects.random_subjects`) that were committed
before any run. Everything else, including the poses, is as in :mod:`benchmark.datasets.humans`.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.datasets import humans
from benchmark.datasets.base import Entry
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import PEOPLE, Subject
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh


@dataclass(frozen=True)
class People:
    """Data set of 15 random subjects in 20 poses.

    Parameters
    ----------
    draw
        Index of the draw.
    """

    draw: int = 0
    stand_in_for: str = ""
    half_width: float = humans.Humans.half_width

    @property
    def name(self) -> str:
        """Name on the command line."""
        return f"people[draw={self.draw}]"

    @property
    def title(self) -> str:
        """Name in captions."""
        return "humans drawn at random"

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All 300 shapes by subject, then by pose; no subject of another set has the same name."""
        return tuple(Entry(f"{subject}_{pose}", subject, pose) for subject in PEOPLE[self.draw] for pose in POSES)

    def load(self, entry: Entry) -> Mesh:
        """Generate the mesh of a shape; see :func:`benchmark.datasets.humans.human_meshes`."""
        return humans.human_mesh(self._body(entry), POSES[entry.pose])

    def recipe(self, entry: Entry) -> str:
        """Return the body parameters and joint angles."""
        return humans.recipe(self._body(entry), POSES[entry.pose])

    def _body(self, entry: Entry) -> Subject:
        return PEOPLE[self.draw][entry.subject]

    def camera(self, entry: Entry) -> Camera:
        """Return the front view."""
        return FRONT

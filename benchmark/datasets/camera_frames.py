"""The generated humans of Table I before a perspective depth camera with faults: frames, masks, what is seen."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import Input
from benchmark.datasets.base import Entry, Part
from benchmark.datasets.humans import Humans
from benchmark.depth.frame import ObservedObject, observe
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.reading import DEFAULT_SCALE, Depths, Mask
from benchmark.depth.scene import DepthFaults, Pose, Scene, behind_box, wrong_outline
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh

__all__ = ["CameraFrames"]

DISTANCES, HEIGHTS, LARGEST_ROLL, WALLS = (1.5, 4.0), (0.8, 1.8), 10.0, (0.6, 2.0)
"""Metres from camera to body, and above the floor; degrees by which it is held askew; metres from body to wall."""

ALL_POSES = 20
"""Poses of each subject of the generated humans."""

_STEP_BACK = 0.1
"""Metres by which a camera that does not see the whole body steps back, to the largest distance at most."""


@dataclass(frozen=True)
class CameraFrames:
    """The subjects and poses of the generated humans, each seen once; see :class:`~benchmark.datasets.base.Dataset`.

    A mesh of it is the surface that the camera sees, in metres: to the right, up, towards the camera.

    Parameters
    ----------
    seed
        Of cameras, walls and faults.
    poses
        Poses of each subject, evenly spread over all; beyond 20 all.
    distance
        Metres from camera to body; 0 draws it.
    noise
        Noise and steps of the camera, over those that it has.
    missing
        Share of the pixels without a depth.
    wrong_mask
        Pixels of the mask that are wrong, its outline being moved to and fro, over those of the object; .5 at most.
    hidden
        Share of the pixels of the object that a box hides which stands before it, from one side or from below.
    """

    seed: int = 0
    poses: int = 20
    distance: float = 0.0
    noise: float = 1.0
    missing: float = DepthFaults.missing
    wrong_mask: float = 0.0
    hidden: float = 0.0

    stand_in_for: ClassVar[str] = ""
    half_width: ClassVar[float] = HALF_WIDTH
    inputs: ClassVar[tuple[Input, ...]] = ("view",)
    intrinsics: ClassVar[Intrinsics] = Intrinsics(365.0, 365.0, 319.5, 239.5, (640, 480))
    """Of a lens as wide as that of a time-of-flight camera: 82 x 67 degrees."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        return "camera" if self.poses >= ALL_POSES else "camera-few"

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"{self.name} (generated, 15 subjects x {min(self.poses, ALL_POSES)} poses before a depth camera)"

    @property
    def faults(self) -> DepthFaults:
        """Faults of the camera."""
        of_camera = DepthFaults()
        return replace(
            of_camera, noise=self.noise * of_camera.noise, step=self.noise * of_camera.step, missing=self.missing
        )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The shapes: 15 for each pose."""
        count = min(self.poses, ALL_POSES)
        return Part(poses=tuple(place * ALL_POSES // count for place in range(count))).of(_humans())

    def load(self, entry: Entry) -> Mesh:
        """Return the surface of the body that the camera sees; raises ``DepthError`` if too little is seen."""
        return self.observed(entry).surface

    def observed(self, entry: Entry) -> ObservedObject:
        """Return what is found in the frame with its mask."""
        depths, mask = self.frame(entry)
        return observe(depths, self.intrinsics, mask)

    def frame(self, entry: Entry) -> tuple[Depths, Mask]:
        """Return depths in metres, as they are written in millimetres, and the pixels of the body, shape (480, 640)."""
        depths, mask = self.scene(entry).drawn(self.intrinsics)
        if self.hidden:
            depths, mask = behind_box(depths, mask, self.hidden, self._random(entry, "box"))
        measured = self.faults.perturbed(depths, self._random(entry, "faults"))
        if self.wrong_mask:
            mask = wrong_outline(mask, self.wrong_mask, self._random(entry, "mask"))
        return np.round(measured * DEFAULT_SCALE) / DEFAULT_SCALE, mask

    def scene(self, entry: Entry) -> Scene:
        """Return the body before floor and wall, and where the camera stands."""
        body = _humans().load(entry)
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        standing = body.with_vertices(body.vertices - [*(low + high)[:2] / 2, low[2]])
        return self._placed(entry, standing)

    def recipe(self, entry: Entry) -> str:
        """Name the values of the body and the angles of its joints, the camera, its place and its faults."""
        where = (self.distance or DISTANCES, HEIGHTS, LARGEST_ROLL, WALLS)
        wrong = f"{self.wrong_mask} {self.hidden}"
        return f"{_humans().recipe(entry)} seed {self.seed} {self.intrinsics} {self.faults} {where} {wrong}"

    def camera(self, entry: Entry) -> Camera:
        """Look at the surface as the camera did, but level."""
        return UPRIGHT

    def _placed(self, entry: Entry, body: Mesh) -> Scene:
        random = self._random(entry, "place")
        distance, height, wall = (float(random.uniform(*limits)) for limits in (DISTANCES, HEIGHTS, WALLS))
        distance = self.distance or distance
        roll = float(random.uniform(-LARGEST_ROLL, LARGEST_ROLL))
        target = (0.0, 0.0, float(body.vertices[:, 2].max()) / 2)
        while True:
            pose = Pose((0.0, -distance, height), target, roll)
            if distance >= DISTANCES[1] or self._sees(pose, body):
                return Scene(body, pose, wall)
            distance = min(distance + _STEP_BACK, DISTANCES[1])

    def _sees(self, pose: Pose, body: Mesh) -> bool:
        """Return whether all of a body is in the image."""
        points = pose.seen(body.vertices)
        if points[:, 2].min() <= 0:
            return False
        camera, (width, height) = self.intrinsics, self.intrinsics.size or (0, 0)
        columns = camera.fx * points[:, 0] / points[:, 2] + camera.cx
        rows = camera.fy * points[:, 1] / points[:, 2] + camera.cy
        return bool(min(columns.min(), rows.min()) > 0 and columns.max() < width - 1 and rows.max() < height - 1)

    def _random(self, entry: Entry, purpose: str) -> np.random.Generator:
        name = hashlib.sha256(f"{self.seed}|{entry.identifier}|{purpose}".encode()).digest()
        return np.random.default_rng(int.from_bytes(name[:8], "big"))


@functools.cache
def _humans() -> Humans:
    return Humans()

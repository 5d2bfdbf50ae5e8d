"""Frames, masks and observed surfaces of the generated humans (Table I) from a simulated perspective depth camera."""

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
"""Distance to the body, height above the floor, roll in degrees, and distance of the wall; lengths in metres."""

ALL_POSES = 20
"""Number of poses per subject of the generated humans."""

_STEP_BACK = 0.1
"""Step in metres by which a camera moves back until it sees the whole body, up to the maximum distance."""


@dataclass(frozen=True)
class CameraFrames:
    """A frame of each shape of the generated humans; see :class:`~benchmark.datasets.base.Dataset`.

    The mesh of a frame is the visible surface, in metres: right, up, towards the camera.

    Parameters
    ----------
    seed
        Seed of cameras, walls and faults.
    poses
        Number of poses per subject, evenly spaced; at most 20.
    distance
        Distance from camera to body in metres; 0 for random.
    noise
        Factor on the nominal noise and quantisation of the camera.
    missing
        Fraction of pixels without a depth.
    wrong_mask
        Number of wrong mask pixels, from a displaced outline, relative to the object; at most .5.
    hidden
        Fraction of the object pixels occluded by a box in front of it, from one side or from below.
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
    """Intrinsics with the field of view of a time-of-flight camera: 82 x 67 degrees."""

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
        """Shapes, 15 per pose."""
        count = min(self.poses, ALL_POSES)
        return Part(poses=tuple(place * ALL_POSES // count for place in range(count))).of(_humans())

    def load(self, entry: Entry) -> Mesh:
        """Return the visible surface of the body; raises ``DepthError`` if it is too small."""
        return self.observed(entry).surface

    def observed(self, entry: Entry) -> ObservedObject:
        """Return the object segmented from the frame with its mask."""
        depths, mask = self.frame(entry)
        return observe(depths, self.intrinsics, mask)

    def frame(self, entry: Entry) -> tuple[Depths, Mask]:
        """Return depths in metres, rounded to millimetres, and the mask of the body, shape (480, 640)."""
        depths, mask = self.scene(entry).drawn(self.intrinsics)
        if self.hidden:
            depths, mask = behind_box(depths, mask, self.hidden, self._random(entry, "box"))
        measured = self.faults.perturbed(depths, self._random(entry, "faults"))
        if self.wrong_mask:
            mask = wrong_outline(mask, self.wrong_mask, self._random(entry, "mask"))
        return np.round(measured * DEFAULT_SCALE) / DEFAULT_SCALE, mask

    def scene(self, entry: Entry) -> Scene:
        """Return the scene: body, floor, wall and camera pose."""
        body = _humans().load(entry)
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        standing = body.with_vertices(body.vertices - [*(low + high)[:2] / 2, low[2]])
        return self._placed(entry, standing)

    def recipe(self, entry: Entry) -> str:
        """Return the body parameters, joint angles, camera, placement ranges and faults."""
        where = (self.distance or DISTANCES, HEIGHTS, LARGEST_ROLL, WALLS)
        wrong = f"{self.wrong_mask} {self.hidden}"
        return f"{_humans().recipe(entry)} seed {self.seed} {self.intrinsics} {self.faults} {where} {wrong}"

    def camera(self, entry: Entry) -> Camera:
        """Return the view of the depth camera, levelled."""
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
        """Return whether the whole body is in the image."""
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

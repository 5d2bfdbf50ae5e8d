"""A figure before a floor and a wall, as a perspective depth camera with the faults of a real one
sees it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh

from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.mesh import Mesh, Points
from benchmark.geometry.rasterise import NOT_BEHIND, draw_triangles

KINECT = Intrinsics(525.0, 525.0, 319.5, 239.5, (640, 480))
"""Nominal intrinsics of a structured-light camera of 640 x 480 pixels."""

SMALL_CAMERA = Intrinsics(262.5, 262.5, 159.75, 119.75, (320, 240))
"""The camera of every second row and column of its images, which take a quarter of the time."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A body on the floor (z = 0) that a camera looks at; the wall lies at ``wall`` along y, other
    meshes around it.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float] = (0.0, 0.0, 0.85)
    roll: float = 0.0
    wall: float | None = 1.2
    floor: bool = True
    others: tuple[Mesh, ...] = ()
    body: Mesh | None = None

    @property
    def rotation(self) -> Points:
        """Right, down and forward of the camera in the world."""
        forward = np.subtract(self.target, self.position) / np.linalg.norm(
            np.subtract(self.target, self.position)
        )
        right = np.cross(forward, (0.0, 0.0, 1.0)) / np.linalg.norm(forward[:2])
        angle = np.radians(self.roll)
        turned = np.cos(angle) * right + np.sin(angle) * np.cross(forward, right)
        return np.stack([turned, np.cross(forward, turned), forward])

    def drawn(self, camera: Intrinsics = KINECT) -> tuple[Depths, Mask]:
        """Return the depth image, metres, and the pixels of the body."""
        standing = self.body or figure()
        body, *rest = (self._mesh(mesh, camera) for mesh in (standing, *self.others))
        lowest = standing.vertices[:, 2].min()
        rest += [self._plane((0, 0, 1), lowest, camera)] if self.floor else []
        rest += [self._plane((0, -1, 0), -self.wall, camera)] if self.wall is not None else []
        nothing = np.full_like(body, np.inf)
        behind = np.min([nothing, *(np.where(image > 0, image, np.inf) for image in rest)], axis=0)
        mask = (body > 0) & (body <= behind)
        return np.where(mask, body, np.where(np.isfinite(behind), behind, 0)), mask

    def _mesh(self, mesh: Mesh, camera: Intrinsics) -> Depths:
        x, y, z = ((mesh.vertices - np.asarray(self.position)) @ self.rotation.T).T
        # The centre of the first pixel is 0 for the camera and 1/2 for the rasteriser; 1/z is
        # linear in the image.
        pixels = np.stack(
            [camera.fx * x / z + camera.cx + 0.5, camera.fy * y / z + camera.cy + 0.5, -1 / z],
            axis=1,
        )
        image = np.zeros((480, 640), dtype=np.float32)
        draw_triangles(np.ascontiguousarray(pixels), mesh.faces, image, NOT_BEHIND)
        return np.divide(-1.0, image, out=np.zeros(image.shape), where=image < 0)

    def _plane(
        self, normal: tuple[float, float, float], offset: float, camera: Intrinsics
    ) -> Depths:
        rays = np.concatenate([camera.rays(640, 480), np.ones((480, 640, 1))], axis=-1)
        with np.errstate(divide="ignore"):
            depths = (offset - np.dot(normal, self.position)) / (rays @ (self.rotation @ normal))
        return np.where(np.isfinite(depths) & (depths > 0.1), depths, 0.0)


def measured(depths: Depths, seed: int = 0) -> Depths:
    """Return depths with noise, steps, missing and flying pixels [Khoshelham and Elberink 2012], up
    to 8 m.
    """
    random = np.random.default_rng(seed)
    padded = np.pad(depths, 1, mode="edge")
    farthest = np.maximum.reduce(
        [padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]]
    )
    at_jump = (depths > 0) & (farthest - depths > 0.05)
    flies = at_jump & (random.random(depths.shape) < 0.1)
    found = depths + flies * (farthest - depths) * random.random(depths.shape)
    lost = (random.random(depths.shape) < 0.01) | (
        at_jump & ~flies & (random.random(depths.shape) < 0.4)
    )
    found += 0.001425 * found**2 * random.standard_normal(depths.shape)
    with np.errstate(divide="ignore"):
        found = 1 / (
            np.round(1 / found / 0.00285) * 0.00285
        )  # uniform steps of the inverse depth, like disparities
    return np.where(
        (depths > 0) & (depths <= 8) & ~lost & np.isfinite(found) & (found > 0), found, 0.0
    )


def capsule(start, end, radius):
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    made = trimesh.creation.capsule(
        height=np.linalg.norm(end - start), radius=radius, count=[24, 24]
    )
    made.apply_translation(-made.bounds.mean(axis=0))
    made.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], end - start))
    made.apply_translation((start + end) / 2)
    return made


@cache
def figure(height=1.7):
    """A figure with trunk, head, arms and legs that stands at the origin, z up, facing -y."""
    parts = [
        capsule((0, 0, 0.85), (0, 0, 1.35), 0.16),
        capsule((0, 0, 1.6), (0, 0, 1.68), 0.11),
        capsule((0.2, 0, 1.35), (0.6, -0.05, 1.0), 0.05),
        capsule((-0.2, 0, 1.35), (-0.6, -0.05, 1.0), 0.05),
        capsule((0.1, 0, 0.85), (0.2, 0, 0.08), 0.08),
        capsule((-0.1, 0, 0.85), (-0.2, 0, 0.08), 0.08),
    ]
    made = trimesh.util.concatenate(parts)
    return Mesh(made.vertices * height / 1.79, made.faces.astype(np.int32))


@cache
def frame(
    seed: int = 0, distance: float = 2.5, height: float = 1.2, **given: object
) -> tuple[Depths, Mask]:
    """Return depths in metres as a structured-light camera measures them, and the pixels of the
    figure with a depth.
    """
    depths, mask = Scene((0.2, -distance, height), **given).drawn()
    found = measured(depths, seed)
    return found, mask & (found > 0)


def small_frame(seed: int = 0) -> tuple[Depths, Mask]:
    """Return every second row and column of a frame, as ``SMALL_CAMERA`` sees it."""
    depths, mask = frame(seed)
    return np.ascontiguousarray(depths[::2, ::2]), np.ascontiguousarray(mask[::2, ::2])


def overlap(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / (one | other).sum())


def in_millimetres(depths: Depths) -> np.ndarray:
    return np.round(1000 * depths).astype(np.uint16)

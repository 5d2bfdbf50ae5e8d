"""Scenes that tests draw: a figure of capsules before a floor and a wall, and the faults of a depth camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh

from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.mesh import Faces, Mesh, Points
from benchmark.geometry.rasterise import NOT_BEHIND, draw_triangles

KINECT = Intrinsics(525.0, 525.0, 319.5, 239.5, (640, 480))
"""Nominal intrinsics of a structured-light camera of 640 x 480 pixels."""

#: Near clipping depth, in metres.
_NEAREST = 0.1


@dataclass(frozen=True)
class Pose:
    """Position and orientation of a camera.

    Parameters
    ----------
    position
        Position in the world (x, y, z up), metres.
    target
        Point that the camera looks at.
    roll
        Roll about the optical axis, in degrees.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    roll: float = 0.0

    @property
    def rotation(self) -> Points:
        """Rotation with rows right, down and forward in the world, shape (3, 3)."""
        forward = np.subtract(self.target, self.position)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        angle = np.radians(self.roll)
        turned = np.cos(angle) * right + np.sin(angle) * down
        return np.stack([turned, np.cross(forward, turned), forward])

    def seen(self, points: Points) -> Points:
        """Transform world points to the camera's frame: right, down, forward."""
        return np.asarray((points - np.asarray(self.position)) @ self.rotation.T)


def perspective_depth(points: Points, faces: Faces, camera: Intrinsics, size: tuple[int, int]) -> Depths:
    """Return the depth image of a surface, shape (h, w), metres; 0 outside the surface.

    Parameters
    ----------
    points, faces
        Surface in the camera's frame; triangles with a vertex nearer than 0.1 m are not drawn.
    camera
        Intrinsics without distortion.
    size
        Width and height in pixels.
    """
    width, height = size
    drawn = np.ascontiguousarray(faces[(points[faces, 2] > _NEAREST).all(axis=1)], dtype=np.int32)
    z = np.maximum(points[:, 2], _NEAREST)
    # The centre of the first pixel is 0 for the camera and 1/2 for the rasteriser; 1/z is linear in the image.
    pixels = np.stack(
        [camera.fx * points[:, 0] / z + camera.cx + 0.5, camera.fy * points[:, 1] / z + camera.cy + 0.5, -1 / z], axis=1
    )
    image = np.zeros((height, width), dtype=np.float32)
    draw_triangles(np.ascontiguousarray(pixels), drawn, image, NOT_BEHIND)
    with np.errstate(divide="ignore"):
        return np.where(image < 0, -1 / image.astype(np.float64), 0.0)


def plane_depth(
    normal: Sequence[float], point: Sequence[float], pose: Pose, camera: Intrinsics, size: tuple[int, int]
) -> Depths:
    """Return the depth image of an infinite plane in the world, shape (h, w), metres; 0 outside the plane.

    Parameters
    ----------
    normal, point
        Normal and a point of the plane.
    pose, camera, size
        Pose, intrinsics and image size of the camera.
    """
    across = pose.rotation @ np.asarray(normal, dtype=np.float64)
    height = float(np.dot(normal, np.subtract(point, pose.position)))
    rays = camera.rays(*size)
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = height / (rays[..., 0] * across[0] + rays[..., 1] * across[1] + across[2])
    return np.where(np.isfinite(depths) & (depths > _NEAREST), depths, 0.0)


def nearest(*depths: Depths) -> Depths:
    """Return the pixelwise minimum of several depth images; 0 for missing depth."""
    stacked = np.stack([np.where(image > 0, image, np.inf) for image in depths]).min(axis=0)
    return np.where(np.isfinite(stacked), stacked, 0.0)


@dataclass(frozen=True)
class DepthFaults:
    """Measurement faults of a structured-light camera.

    Parameters
    ----------
    noise
        Standard deviation at 1 m, in metres; it grows with the square of the depth.
    step
        Depth resolution at 1 m, in metres; it grows with the square of the depth.
    missing
        Fraction of all pixels without a depth.
    edge
        Fraction of the pixels at depth jumps without a depth.
    flying
        Fraction of the pixels at depth jumps with a depth between the two surfaces.
    farthest
        Maximum measurable depth, in metres.

    References
    ----------
    Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data for indoor mapping applications", Sensors
    2012: standard deviation 1.425 mm and step 2.85 mm at 1 m, both growing with the square of the depth.
    """

    noise: float = 0.001425
    step: float = 0.00285
    missing: float = 0.01
    edge: float = 0.4
    flying: float = 0.1
    farthest: float = 8.0

    def perturbed(self, depths: Depths, random: np.random.Generator) -> Depths:
        """Return depths with noise, quantisation, missing pixels, missing edges and flying pixels."""
        seen = (depths > 0) & (depths <= self.farthest)
        padded = np.pad(depths, 1, mode="edge")
        around = [padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]]
        farthest = np.maximum.reduce(around)
        at_jump = seen & (farthest - depths > 0.05)
        measured = depths.copy()
        flies = at_jump & (random.random(depths.shape) < self.flying)
        measured[flies] += (farthest - depths)[flies] * random.random(int(flies.sum()))
        lost = (random.random(depths.shape) < self.missing) | (
            at_jump & ~flies & (random.random(depths.shape) < self.edge)
        )
        measured += self.noise * measured**2 * random.standard_normal(depths.shape)
        if self.step:
            # Uniform steps of the inverse depth, like disparities.
            with np.errstate(divide="ignore"):
                inverse = np.round(1 / measured / self.step) * self.step
                measured = np.where(inverse > 0, 1 / inverse, 0)
        return np.where(seen & ~lost & np.isfinite(measured) & (measured > 0), measured, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """A body standing on a floor.

    Parameters
    ----------
    body
        Mesh in the world, z up; its lowest point lies on the floor.
    pose
        Pose of the camera.
    wall
        Distance from the origin to the wall behind it, along +y, in metres; None for no wall.
    floor
        Whether the scene has a floor.
    others
        Further surfaces outside the object.
    """

    body: Mesh
    pose: Pose
    wall: float | None = 1.5
    floor: bool = True
    others: tuple[Mesh, ...] = ()

    def drawn(self, camera: Intrinsics = KINECT, size: tuple[int, int] = (640, 480)) -> tuple[Depths, Mask]:
        """Return the depth image of the scene, shape (h, w), metres, and the mask of the body."""
        body = perspective_depth(self.pose.seen(self.body.vertices), self.body.faces, camera, size)
        rest = [perspective_depth(self.pose.seen(mesh.vertices), mesh.faces, camera, size) for mesh in self.others]
        if self.floor:
            low = float(self.body.vertices[:, 2].min())
            rest.append(plane_depth((0, 0, 1), (0, 0, low), self.pose, camera, size))
        if self.wall is not None:
            rest.append(plane_depth((0, -1, 0), (0, self.wall, 0), self.pose, camera, size))
        behind = nearest(*rest) if rest else np.zeros_like(body)
        mask = (body > 0) & ((behind == 0) | (body <= behind))
        return np.where(mask, body, behind), mask


def capsule(start, end, radius):
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    made = trimesh.creation.capsule(height=np.linalg.norm(end - start), radius=radius, count=[24, 24])
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


def scene(distance=2.5, height=1.2, roll=0.0, wall=1.2, **further):
    return Scene(figure(), Pose((0.2, -distance, height), (0, 0, 0.85), roll), wall=wall, **further)


@cache
def frame(seed=0, **given):
    """Depths in metres as a structured-light camera measures them, and the pixels of the figure with a depth."""
    depths, mask = scene(**given).drawn(KINECT)
    measured = DepthFaults().perturbed(depths, np.random.default_rng(seed))
    return measured, mask & (measured > 0)


def overlap(one, other):
    return float((one & other).sum() / (one | other).sum())


def in_millimetres(depths):
    return np.round(1000 * depths).astype(np.uint16)

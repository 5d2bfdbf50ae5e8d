"""Scenes that a perspective depth camera sees: a body before a floor and a wall, and the faults of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.reading import Depths, Mask
from benchmark.geometry.mesh import Faces, Mesh, Points

KINECT = Intrinsics(525.0, 525.0, 319.5, 239.5, (640, 480))
"""Nominal intrinsics of a structured-light camera of 640 x 480 pixels."""

#: Nearest depth that is drawn, in metres.
_NEAREST = 0.1


@dataclass(frozen=True)
class Pose:
    """Position and orientation of a camera.

    Parameters
    ----------
    position
        In the world (x, y, z up), metres.
    target
        What it looks at.
    roll
        By which it is held askew, in degrees.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    roll: float = 0.0

    @property
    def rotation(self) -> Points:
        """Rows are right, down and forward in the world, shape (3, 3)."""
        forward = np.subtract(self.target, self.position)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        angle = np.radians(self.roll)
        turned = np.cos(angle) * right + np.sin(angle) * down
        return np.stack([turned, np.cross(forward, turned), forward])

    def seen(self, points: Points) -> Points:
        """Return points of the world in the camera's frame: right, down, forward."""
        return np.asarray((points - np.asarray(self.position)) @ self.rotation.T)


def perspective_depth(points: Points, faces: Faces, camera: Intrinsics, size: tuple[int, int]) -> Depths:
    """Return the depths of a surface, shape (h, w), metres; 0 where it is not seen.

    Parameters
    ----------
    points, faces
        A surface in the camera's frame; triangles with a corner nearer than 0.1 m are not drawn.
    camera
        Without distortion.
    size
        Width and height.
    """
    from benchmark.geometry.rasterise import NOT_BEHIND, draw_triangles  # numba is imported with it

    width, height = size
    drawn = np.ascontiguousarray(faces[(points[faces, 2] > _NEAREST).all(axis=1)], dtype=np.int32)
    z = np.maximum(points[:, 2], _NEAREST)
    # The centre of the first pixel lies at 0 for a camera and at 1/2 for the rasteriser; 1/z is linear in the image.
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
    """Return the depths of an endless plane of the world, shape (h, w), metres; 0 where it is not seen.

    Parameters
    ----------
    normal, point
        Of the plane.
    pose, camera, size
        The camera.
    """
    across = pose.rotation @ np.asarray(normal, dtype=np.float64)
    height = float(np.dot(normal, np.subtract(point, pose.position)))
    rays = camera.rays(*size)
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = height / (rays[..., 0] * across[0] + rays[..., 1] * across[1] + across[2])
    return np.where(np.isfinite(depths) & (depths > _NEAREST), depths, 0.0)


def nearest(*depths: Depths) -> Depths:
    """Return the nearest of several depths at each pixel; 0 where there is none."""
    stacked = np.stack([np.where(image > 0, image, np.inf) for image in depths]).min(axis=0)
    return np.where(np.isfinite(stacked), stacked, 0.0)


@dataclass(frozen=True)
class DepthFaults:
    """Faults that a structured-light camera adds to depths.

    Parameters
    ----------
    noise
        Standard deviation at a metre, in metres; it grows with the square of the depth.
    step
        Distance of two depths that can be told apart at a metre, in metres; it grows alike.
    missing
        Share of the pixels without a depth.
    edge
        Share of the pixels at depth jumps without a depth.
    flying
        Share of the pixels at depth jumps with a depth between the two.
    farthest
        Depth in metres beyond which nothing is measured.

    References
    ----------
    Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data for indoor mapping applications", Sensors
    2012: standard deviation 1.425 mm and step 2.85 mm at a metre, both growing with the square of the depth.
    """

    noise: float = 0.001425
    step: float = 0.00285
    missing: float = 0.01
    edge: float = 0.4
    flying: float = 0.1
    farthest: float = 8.0

    def perturbed(self, depths: Depths, random: np.random.Generator) -> Depths:
        """Return depths with noise, steps, lost pixels, lost edges and flying pixels."""
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
            # Even steps of the inverse depth, as disparities have them.
            with np.errstate(divide="ignore"):
                inverse = np.round(1 / measured / self.step) * self.step
                measured = np.where(inverse > 0, 1 / inverse, 0)
        return np.where(seen & ~lost & np.isfinite(measured) & (measured > 0), measured, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """A body that stands on a floor.

    Parameters
    ----------
    body
        In the world, z up; its lowest point lies on the floor.
    pose
        The camera.
    wall
        Metres between the origin and the wall behind it, along +y; None for no wall.
    floor
        Whether there is one.
    others
        Further surfaces, which are not the object.
    """

    body: Mesh
    pose: Pose
    wall: float | None = 1.5
    floor: bool = True
    others: tuple[Mesh, ...] = ()

    def drawn(self, camera: Intrinsics = KINECT, size: tuple[int, int] = (640, 480)) -> tuple[Depths, Mask]:
        """Return the depths of the scene, shape (h, w), metres, and the pixels that show the body."""
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


def behind_box(
    depths: Depths, mask: Mask, share: float, random: np.random.Generator, distance: float = 0.3
) -> tuple[Depths, Mask]:
    """Return depths and mask of a frame in which the flat face of a box hides some of the object.

    Parameters
    ----------
    depths, mask
        The frame, shapes (h, w).
    share
        Of the pixels of the object that are hidden: all that are to the left or right of a column, or below a row, of
        which the one is drawn at random.
    random
        Draws it.
    distance
        Metres from the face to the nearest pixel of the object.
    """
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return depths, mask
    grid = np.indices(mask.shape)
    along, places = ((grid[1], columns), (-grid[1], -columns), (-grid[0], -rows))[int(random.integers(3))]
    face = along <= np.quantile(places, share)
    nearest_depth = max(float(depths[mask].min()) - distance, _NEAREST)
    return np.where(face, nearest_depth, depths), mask & ~face


def wrong_outline(mask: Mask, share: float, random: np.random.Generator) -> Mask:
    """Return a mask whose outline is moved to and fro by a smooth random field.

    Parameters
    ----------
    mask
        The true one, shape (h, w).
    share
        Of the pixels that are wrong, over those of the mask; reached to half a pixel in a hundred.
    random
        Draws the field.
    """
    if not mask.any():
        return mask
    signed = distance_transform_edt(mask) - distance_transform_edt(~mask)
    field = gaussian_filter(random.standard_normal(mask.shape), np.sqrt(mask.sum()) / 10)
    field /= field.std()
    low, high = 0.0, float(max(mask.shape))
    for _ in range(30):  # the number of wrong pixels grows with the size of the field
        middle = (low + high) / 2
        wrong = np.count_nonzero((signed + middle * field > 0) != mask)
        low, high = (middle, high) if wrong < share * mask.sum() else (low, middle)
    return np.asarray(signed + high * field > 0)

"""A wider stream of bodies at a third of the cost: harder poses, several views per pose, no authored poses."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from benchmark.api.streaming import N_POINTS, Fresh
from benchmark.datasets.human_poses import Arm, Column, Leg, Pose
from benchmark.datasets.varied.bodies import varied_body
from benchmark.datasets.varied.camera import Perturbations, both_sides, drawn_perturbations, rendered, turned
from benchmark.datasets.varied.coarse import CoarseModel, Resting, coarse_model
from benchmark.datasets.varied.model import CANONICAL
from benchmark.datasets.varied.poses import range_of_motion
from benchmark.datasets.varied.sampler import (
    LARGEST_DOUBLED,
    MOST_DRAWS,
    POSES_OVERLAP,
    SHARES,
    doubled_share,
    drawn_bodies,
    height_of,
    hopeless,
)
from benchmark.geometry.mesh import Faces, Points
from benchmark.geometry.rasterise import DepthImage

Limits = tuple[NDArray[np.float64], NDArray[np.float64]]

FRONTAL_SHARE, FRONTAL = 0.5, 25.0
"""Fraction of views within 25 degrees of the front; the others are from any side, including the back."""

NEAREST, FARTHEST = 1.2, 4.0
"""Range of distances of a perspective camera, as multiples of the height of the standing body."""

AVERAGED = 256
"""Number of bodies for the average used to standardise the points of a body."""

AGAIN = 4
"""Number of poses drawn at once to replace a pose with self-intersections."""

_BEHIND = 0.01
"""Minimum depth of a hidden point behind the surface at its pixel, as a fraction of the frame."""

_LEAST_DEPTH = 1e-3
"""Minimum foreground depth."""


@dataclass(frozen=True, kw_only=True)
class WideSampler:
    """Sampler of batches; see :class:`benchmark.api.streaming.MakesFresh`.

    Parameters
    ----------
    seed
        Seed of the stream; streams with different seeds share no body.
    poses
        Number of poses per body.
    views
        Number of images per pose, with individual views and faults.
    triangles
        Number of triangles of a rendered body.
    everyday, crouched, reaching
        Fractions of poses near standing, with bent hips and knees, and with the arms in front of the body. In all other
        poses, every angle is drawn independently within the range of motion.
    perspective
        Fraction of images from a perspective camera.
    held
        Fraction of images with an object in a hand.
    """

    seed: int
    poses: int = 2
    views: int = 1
    triangles: int = 7000
    everyday: float = 0.3
    crouched: float = 0.15
    reaching: float = 0.15
    perspective: float = 0.5
    held: float = 0.1

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        """Generate a batch; the images of a body are ordered by pose, then by view."""
        model, redrawn = coarse_model(self.triangles), Counter[str]()
        names = [f"wide-{self.seed}-{number}-{place}" for place in range(bodies)]
        # One more seed value than in `Sampler`, so that no bodies are shared.
        randoms = [np.random.default_rng([self.seed, number, place, 1]) for place in range(bodies)]
        shapes, posed = self._drawn(model, names, randoms, redrawn)
        images = np.zeros((bodies, self.poses * self.views, size, size), dtype=np.float32)
        fronts, backs = (np.zeros((bodies, size, size), dtype=np.float32) for _ in range(2))
        count = len(shapes[0])
        pixels = np.empty((bodies, self.poses * self.views, count, 2), dtype=np.float32)
        places = np.empty((bodies, count, 3), dtype=np.float32)
        for place, random in enumerate(randoms):
            target = turned(shapes[place], Perturbations())
            half_width = _half_width(target, random)
            fronts[place], backs[place] = both_sides(target, model.faces, half_width, size)
            height = height_of(shapes[place])
            places[place] = target / height
            for row in range(self.poses * self.views):
                pose = posed[place, row // self.views]
                images[place, row], pixels[place, row] = self._view(model, pose, height, size, random)
        return Fresh(
            identifiers=tuple(names), images=images, fronts=fronts, backs=backs, drawn_again=dict(redrawn),
            pixels=pixels, places=places, points=_standardised(places, self.triangles),
        )  # fmt: skip

    def _drawn(
        self, model: CoarseModel, names: list[str], randoms: list[np.random.Generator], redrawn: Counter[str]
    ) -> tuple[list[Points], NDArray[np.float64]]:
        """Draw bodies; returns their vertices in the canonical pose and in the drawn poses, see :meth:`_posed`."""

        def standing(candidates: Sequence[Resting]) -> Iterable[Points]:
            return model.posed(candidates, np.tile(CANONICAL.angles(), (len(candidates), 1)))

        drawn, shapes = drawn_bodies(model.shaped, standing, model.faces, names, randoms, redrawn)
        return shapes, self._posed(model, names, drawn, shapes, randoms, redrawn)

    def _posed(
        self,
        model: CoarseModel,
        names: list[str],
        bodies: list[Resting],
        shapes: list[Points],
        randoms: list[np.random.Generator],
        redrawn: Counter[str],
    ) -> NDArray[np.float64]:
        """Return the vertices of each body in poses without self-intersections, shape (bodies, poses, n, 3)."""
        accepted = np.empty((len(names), self.poses, *shapes[0].shape))
        missing = [(place, pose) for place in range(len(names)) for pose in range(self.poses)]
        for round_number in range(MOST_DRAWS):
            # One pose in three is redrawn: later rounds draw several at once, so that few rounds suffice.
            slots = [slot for slot in missing for _ in range(AGAIN if round_number else 1)]
            angles = np.stack([self.angles(randoms[place]) for place, _ in slots])
            posed = model.posed([bodies[place] for place, _ in slots], angles)
            for (place, pose), vertices in zip(slots, posed, strict=True):
                if (place, pose) not in missing:
                    continue
                if doubled_share(vertices, model.faces, height_of(shapes[place])) > LARGEST_DOUBLED:
                    redrawn[POSES_OVERLAP] += 1
                else:
                    accepted[place, pose] = vertices
                    missing.remove((place, pose))
            if not missing:
                return accepted
        raise hopeless(names[missing[0][0]])

    def angles(self, random: np.random.Generator) -> NDArray[np.float64]:
        """Draw the angles of a pose that faces the front, shape (27,)."""
        shares = (self.everyday, self.crouched, self.reaching)
        kind = int(np.searchsorted(np.cumsum(shares), random.random(), side="right"))
        lower, upper = (*kinds(), range_of_motion())[kind]
        return random.uniform(lower, upper)

    def _view(
        self, model: CoarseModel, vertices: Points, height: float, size: int, random: np.random.Generator
    ) -> tuple[DepthImage, NDArray[np.float32]]:
        """Render a posed body from a random view with random faults; returns the image and the pixels of vertices."""
        count, wrong = len(vertices), drawn_perturbations(random)
        hidden = [hand for hand, is_missing in zip(model.hands, wrong.missing, strict=True) if is_missing]
        faces = model.faces[~np.any(hidden, axis=0)] if hidden else model.faces
        if random.random() < self.held:
            hand = model.faces[model.hands[random.integers(2)]]
            vertices, faces = _holding(vertices, faces, vertices[hand].mean(axis=(0, 1)), height, random)
        angle = np.radians(random.uniform(-1, 1) * (FRONTAL if random.random() < FRONTAL_SHARE else 180.0))
        spin = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        points = turned(vertices @ spin.T, wrong)
        if random.random() < self.perspective:
            distance = height * random.uniform(NEAREST, FARTHEST)
            points[:, :2] *= distance / (distance - points[:, 2:])
        half_width = _half_width(points, random)
        image = rendered(points, _facing(points, faces), half_width, size)
        return _perturbed(image, wrong, random), _seen_at(points[:count], image, half_width)


def _holding(
    vertices: Points, faces: Faces, palm: NDArray[np.float64], height: float, random: np.random.Generator
) -> tuple[Points, Faces]:
    """Add an ellipsoid in a hand, with random orientation and semi-axes of .01 to .12 of the body height."""
    ball = _ball()
    axes = height * np.exp(random.uniform(np.log(0.01), np.log(0.12), 3))
    directions = np.linalg.qr(random.normal(size=(3, 3)))[0]
    own = palm + (ball.vertices * axes) @ directions.T
    return np.concatenate([vertices, own]), np.concatenate([faces, (ball.faces + len(vertices)).astype(np.int32)])


def _standardised(places: NDArray[np.float32], triangles: int) -> NDArray[np.float32]:
    mean, deviation = _average(triangles)
    return np.asarray((_some(places) - mean) / deviation, dtype=np.float32).reshape(len(places), -1)


def _some(places: NDArray[Any]) -> NDArray[Any]:
    return places[:, np.linspace(0, places.shape[1] - 1, N_POINTS).astype(np.int64)]


@functools.cache
def _average(triangles: int) -> tuple[NDArray[np.float64], float]:
    """Return the mean points of random bodies, shape (N_POINTS, 3), and the root mean square deviation from them."""
    model, random = coarse_model(triangles), np.random.default_rng(AVERAGED)
    standing = model.posed(
        model.shaped([varied_body(random) for _ in range(AVERAGED)]), np.tile(CANONICAL.angles(), (AVERAGED, 1))
    )
    places = _some(np.stack([turned(vertices, Perturbations()) / height_of(vertices) for vertices in standing]))
    mean = places.mean(axis=0)
    return mean, float(np.sqrt(np.mean((places - mean) ** 2)))


def _seen_at(points: Points, image: DepthImage, half_width: float) -> NDArray[np.float32]:
    """Return the row and column of each point, shape (n, 2), NaN for occluded points."""
    shares = (points / half_width + 1) / 2
    pixels = np.stack([1 - shares[:, 1], shares[:, 0]], axis=1) * len(image)
    row, column = np.clip(pixels.astype(np.int64), 0, len(image) - 1).T
    hidden = image[row, column] - shares[:, 2] > _BEHIND
    pixels[hidden] = np.nan
    return pixels.astype(np.float32)


def _facing(points: Points, faces: Faces) -> Faces:
    """Return the triangles facing the camera; on a closed surface, no other triangle can be in front."""
    corners = faces.T
    (x, x1, x2), (y, y1, y2) = (np.take(np.ascontiguousarray(points[:, axis]), corners) for axis in range(2))
    return np.asarray(faces[(x1 - x) * (y2 - y) > (y1 - y) * (x2 - x)])


def _perturbed(image: DepthImage, wrong: Perturbations, random: np.random.Generator) -> DepthImage:
    """Return the image with noise, quantisation, holes and missing pixels, drawn for foreground pixels only."""
    rows, columns = np.nonzero(image)
    depths = image[rows, columns].astype(np.float64)
    if wrong.noise:
        depths += wrong.noise * random.standard_normal(len(depths))
    if wrong.step:
        depths = np.round(depths / wrong.step) * wrong.step
    lost = random.random(len(depths)) < wrong.dropped if wrong.dropped else np.zeros(len(depths), dtype=bool)
    for _ in range(wrong.holes):
        place = random.integers(len(depths))
        radius = random.uniform(0.01, 0.04) * len(image)
        lost |= (rows - rows[place]) ** 2 + (columns - columns[place]) ** 2 < radius**2
    if np.count_nonzero(lost) > len(lost) / 2:
        lost[:] = False
    result = np.zeros_like(image)
    result[rows[~lost], columns[~lost]] = np.clip(depths[~lost], _LEAST_DEPTH, 1)
    return result


@functools.cache
def kinds() -> tuple[Limits, ...]:
    """Return the angle limits of poses near standing, with bent hips and knees, and with arms in front of the body."""
    lower, upper = (Pose.from_angles(end) for end in range_of_motion())

    def limits(arms: tuple[Arm, Arm], legs: tuple[Leg, Leg], trunk: tuple[Column, Column] | None = None) -> Limits:
        trunk = trunk or (lower.trunk, upper.trunk)
        ends = zip(arms, legs, trunk, (lower.head, upper.head), (lower.body, upper.body), strict=True)
        low, high = (
            Pose(left_arm=arm, right_arm=arm, left_leg=leg, right_leg=leg, trunk=trunk, head=head, body=body).angles()
            for arm, leg, trunk, head, body in ends
        )
        return low, high

    hanging = Arm(raised=5, forward=-45, roll=-30, bend=0), Arm(raised=60, forward=90, roll=30, bend=100)
    near = Leg(flexion=-20, abduction=0, roll=-10, bend=0, point=-10), Leg(flexion=40, abduction=15, roll=25, bend=50)
    bent = (
        Leg(flexion=60, abduction=-5, roll=-20, bend=50, point=-20),
        Leg(flexion=120, abduction=40, roll=30, bend=135, point=30),
    )
    before = Arm(raised=25, forward=45, roll=-45, bend=20), Arm(raised=110, forward=135, roll=60, bend=150)
    upright = Column(bend=-10, lean=-10, turn=-20), Column(bend=25, lean=10, turn=20)
    free = (lower.left_arm, upper.left_arm), (lower.left_leg, upper.left_leg)
    return limits(hanging, near, upright), limits(free[0], bent), limits(before, free[1])


@functools.cache
def _ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2)


def _half_width(points: Points, random: np.random.Generator) -> float:
    return float(np.abs(points[:, :2]).max()) / random.uniform(*SHARES)

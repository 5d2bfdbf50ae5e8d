"""Depth cameras: viewing directions, and the noise and quantisation of a real sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import FloatArray, Points

#: Largest depth of an image.
_NEAREST = 1.0

#: Least depth of the foreground.
_FARTHEST = 1e-3

#: Largest error of the length of a unit vector.
_ROUNDING = 1e-12

#: Length of what is orthogonal of an up vector, up to which it is parallel to the direction.
_PARALLEL = 1e-9


@dataclass(frozen=True)
class Camera:
    """Viewing direction of an orthographic camera.

    Parameters
    ----------
    direction
        Viewing direction in the coordinates of the shape; normalised on construction.
    up
        Up direction of the image; made orthogonal to ``direction`` and normalised on construction.

    Raises
    ------
    ConfigurationError
        If a vector is zero or not finite, or both are parallel.
    """

    direction: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Make ``direction`` a unit vector, and ``up`` a unit vector orthogonal to it.

        Raises
        ------
        ConfigurationError
            If one of them is zero or not finite, or if both are parallel.
        """
        direction = np.asarray(self.direction, dtype=np.float64)
        up = np.asarray(self.up, dtype=np.float64)
        length = np.linalg.norm(direction)
        has_direction = np.isfinite(length) and length > 0
        if has_direction:
            direction = _normalised(direction, length)
            up = up - (up @ direction) * direction
        height = np.linalg.norm(up)
        has_up = np.isfinite(height) and height > _PARALLEL
        if not (has_direction and has_up):
            problem = f"no camera looks along {self.direction} with {self.up} as up"
            hint = "pass two finite vectors that are neither zero nor parallel"
            raise ConfigurationError(problem, hint)
        up = _normalised(up, height)
        # The dataclass is frozen: plain assignments would raise an error.
        object.__setattr__(self, "direction", tuple(direction.tolist()))
        object.__setattr__(self, "up", tuple(up.tolist()))

    @property
    def rotation(self) -> Points:
        """Rotation with rows right, up and towards the camera, shape (3, 3).

        In coordinates of the shape.
        """
        direction = np.asarray(self.direction)
        up = np.asarray(self.up)
        return np.stack([np.cross(direction, up), up, -direction])


def _normalised(vector: FloatArray, length: np.floating) -> FloatArray:
    """Return a vector over its length; one of length 1 stays bitwise identical."""
    if abs(length - 1) <= _ROUNDING:
        return vector
    return np.asarray(vector / length)


FRONT = Camera((0.0, 1.0, 0.0))
"""Camera that looks along +y with z up and faces a body whose face looks along -y."""

SIDE = Camera((1.0, 0.0, 0.0))
"""Camera that looks along +x with z up and sees the flank of an animal that walks along y."""


@dataclass(frozen=True)
class DepthSensor:
    """Noise and quantisation of depth, in units of the image.

    1 is the depth of the frame, two half widths.

    Parameters
    ----------
    noise
        Standard deviation per pixel.
    step
        Quantisation step; 0 for none.
    seed
        Seed of the noise.
    """

    noise: float
    step: float
    seed: int

    def perturbed(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the image with noise, then quantised; the background stays as it is."""
        random = np.random.default_rng(self.seed)
        noisy = depth + self.noise * random.standard_normal(depth.shape)
        stepped = np.round(noisy / self.step) * self.step if self.step else noisy
        return np.where(depth > 0, np.clip(stepped, _FARTHEST, _NEAREST), 0).astype(np.float32)

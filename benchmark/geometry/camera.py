"""Depth cameras: the directions from which they look, and the noise and steps of a real sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Points

#: Largest depth of an image, and the smallest one that is not background.
_NEAREST, _FARTHEST = 1.0, 1e-3


@dataclass(frozen=True)
class Camera:
    """Viewing direction of an orthographic camera.

    Parameters
    ----------
    direction
        Where the camera looks, in coordinates of the shape; normalised on construction.
    up
        What is up in the image; made orthogonal to ``direction`` and normalised on construction.

    Raises
    ------
    ConfigurationError
        If a vector vanishes, is not finite, or both are parallel.
    """

    direction: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        direction = np.asarray(self.direction, dtype=np.float64)
        up = np.asarray(self.up, dtype=np.float64)
        length = np.linalg.norm(direction)
        if np.isfinite(length) and length > 0:
            if abs(length - 1) > 1e-12:  # what is normalised already keeps its bits
                direction = direction / length
            up = up - (up @ direction) * direction
        height = np.linalg.norm(up)
        if not (np.isfinite(length) and length > 0 and np.isfinite(height) and height > 1e-9):
            raise ConfigurationError(
                f"no camera looks along {self.direction} with {self.up} as up",
                "pass two finite vectors that are neither zero nor parallel",
            )
        object.__setattr__(self, "direction", tuple(direction.tolist()))
        if abs(height - 1) > 1e-12:
            up = up / height
        object.__setattr__(self, "up", tuple(up.tolist()))

    @property
    def rotation(self) -> Points:
        """Rows are the axes right, up and towards the camera, in coordinates of the shape; shape (3, 3)."""
        direction, up = np.asarray(self.direction), np.asarray(self.up)
        return np.stack([np.cross(direction, up), up, -direction])


FRONT = Camera((0.0, 1.0, 0.0))
"""Looks along +y with z up, so it faces a body whose face looks along -y."""

SIDE = Camera((1.0, 0.0, 0.0))
"""Looks along +x with z up, so it sees the flank of an animal that walks along y."""


@dataclass(frozen=True)
class DepthSensor:
    """Noise and quantisation of depth, in units of the image (1 is the depth of the frame, two half widths).

    Parameters
    ----------
    noise
        Standard deviation of a pixel.
    step
        Distance of two depths that can be told apart.
    seed
        Seed of the noise.
    """

    noise: float
    step: float
    seed: int

    def perturbed(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """The image with noise, then rounded to steps; background stays background, and surface stays surface."""
        random = np.random.default_rng(self.seed)
        noisy = depth + self.noise * random.standard_normal(depth.shape)
        stepped = np.round(noisy / self.step) * self.step if self.step else noisy
        return np.where(depth > 0, np.clip(stepped, _FARTHEST, _NEAREST), 0).astype(np.float32)

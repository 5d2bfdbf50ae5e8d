"""Sensor model of a real depth camera: noise of each pixel, and steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Largest depth of an image, and the smallest one that is not background.
_NEAREST, _FARTHEST = 1.0, 1e-3


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

"""Depth frames with a perturbation of some strength: ``camera-few[occlusion=3]``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.camera_frames import CameraFrames
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, Perturbed
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh


@dataclass(frozen=True)
class PerturbedFrames(Perturbed):
    """All frames of a camera under one perturbation, which a parameter of the set is."""

    clean: CameraFrames

    def load(self, entry: Entry) -> Mesh:
        """Return what is seen of the object; raises ``DepthError`` if that is too little."""
        given: dict[str, Any] = {PERTURBATIONS[self.perturbation].of_frames: self.amount}
        return replace(self.clean, **given).load(entry)


def perturbed_frames(clean: Dataset, perturbation: str, strength: int) -> PerturbedFrames:
    """Put a set of frames under a perturbation.

    Raises
    ------
    ConfigurationError
        If the set has no frames.
    """
    if isinstance(clean, CameraFrames):
        return PerturbedFrames(clean, perturbation, strength)
    raise ConfigurationError(
        f"{clean.name} has no frames of a depth camera, which '{perturbation}' perturbs",
        "use it with camera or camera-few, or choose a perturbation of surfaces, such as noise",
    )

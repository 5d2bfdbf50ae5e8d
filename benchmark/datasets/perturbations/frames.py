"""Data sets with a perturbation, which of depth frames is one of the camera: ``camera-few[occlusion=3]``."""

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


def perturbed(clean: Dataset, perturbation: str, strength: int) -> Perturbed:
    """Put a data set under a perturbation.

    Raises
    ------
    ConfigurationError
        If the perturbation is one of frames, and the set has none.
    """
    if not PERTURBATIONS[perturbation].of_frames:
        return Perturbed(clean, perturbation, strength)
    if isinstance(clean, CameraFrames):
        return PerturbedFrames(clean, perturbation, strength)
    raise ConfigurationError(
        f"{clean.name} has no frames of a depth camera, which '{perturbation}' perturbs",
        "use it with camera or camera-few, or choose a perturbation of surfaces, such as noise",
    )

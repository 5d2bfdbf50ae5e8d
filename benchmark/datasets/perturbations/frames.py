"""Data sets with a perturbation, which of depth frames is one of the camera: ``camera-few[occlusion=3]``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from benchmark.datasets.base import Dataset
from benchmark.datasets.camera_frames import CameraFrames
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, Perturbed
from benchmark.errors import ConfigurationError


def perturbed(clean: Dataset, perturbation: str, strength: int) -> Perturbed:
    """Put a data set under a perturbation, which of frames is a parameter of the set.

    Raises
    ------
    ConfigurationError
        If the perturbation is one of frames, and the set has none; or if the camera has depth noise already.
    """
    known = PERTURBATIONS[perturbation]
    if known.of_frames and isinstance(clean, CameraFrames):
        given: dict[str, Any] = {known.of_frames: known.amounts[strength - 1]}
        return Perturbed(replace(clean, **given), perturbation, strength)
    if known.of_frames:
        raise ConfigurationError(
            f"{clean.name} has no frames of a depth camera, which '{perturbation}' perturbs",
            "use it with camera or camera-few, or choose a perturbation of surfaces, such as noise",
        )
    sensor = getattr(clean, "sensor", None)
    if perturbation == "depth-noise" and sensor and sensor(clean.entries[0]):
        raise ConfigurationError(f"{clean.name} has depth noise already", "name one strength of depth-noise")
    return Perturbed(clean, perturbation, strength)

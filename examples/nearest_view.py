"""Nearest View: find the most similar training image, and return the canonical pose of its body."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from safetensors.numpy import load, save

from benchmark.api import (
    CARD,
    WEIGHTS,
    CanonicalForm,
    MethodInfo,
    Shape,
    Split,
    TrainingData,
    UnsupportedShape,
    checked_weights,
)
from benchmark.errors import ConfigurationError
from benchmark.geometry.depth import back_project

#: Every so many-th pixel of an image is kept.
STRIDE = 5


@dataclass(frozen=True, kw_only=True)
class NearestView:
    """The nearest neighbour among the training images, pixel by pixel.

    Parameters
    ----------
    training_seed
        Has no effect here. A network would draw its first weights with it.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="nearest-view",
        title="Nearest View",
        summary="canonical pose of the most similar training image",
        inputs=("view",),
        scale="invariant",
    )
    split: ClassVar[Split] = "table"
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")

    training_seed: int = 0
    model: Mapping[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    @property
    def model_name(self) -> str:
        """Name of the folder of the model: another one for each value that changes the training."""
        return f"seed{self.training_seed}"

    def train(
        self,
        data: TrainingData,
        folder: Path,
        options: Mapping[str, Any],
        say: Callable[[str], None],
    ) -> None:
        """Store all pairs at a lower resolution, then the card, which marks a finished model."""
        if options:
            raise ConfigurationError(
                f"nearest-view has no option '{next(iter(options))}'", "leave it out"
            )
        if (folder / CARD).is_file():
            say("finished before")
            return
        pairs = list(data.pairs())
        images = np.stack([pair.image[::STRIDE, ::STRIDE] for pair in pairs]).astype(np.float16)
        targets = np.stack([pair.target[::STRIDE, ::STRIDE] for pair in pairs]).astype(np.float16)
        weights = save({"images": images, "targets": targets})
        folder.mkdir(parents=True, exist_ok=True)
        (folder / WEIGHTS).write_bytes(weights)
        card = {
            "digest": hashlib.sha256(weights).hexdigest(),
            "data": data.name,
            "data_title": data.title,
            "subjects": data.subjects,
            "tested": data.tested,
            "clearance": data.clearance,
            "identifiers": data.identifiers,
            "schedule_in_words": f"{len(pairs)} pairs, kept as they are",
        }
        (folder / CARD).write_text(json.dumps(card), encoding="utf-8")
        say(f"kept {len(pairs)} pairs")

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``."""
        loaded = replace(self)
        object.__setattr__(loaded, "model", load(checked_weights(folder)))
        return loaded

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the surface in the canonical image of the nearest neighbour, scaled to area 1."""
        if shape.depth is None:
            raise UnsupportedShape("there is no depth image", "use the view input")
        if not self.model:
            raise ConfigurationError(
                "nearest-view has no model", "run 'python -m benchmark train nearest-view'"
            )
        image = shape.depth[::STRIDE, ::STRIDE]
        differences = np.abs(self.model["images"].astype(np.float32) - image).sum(axis=(1, 2))
        nearest = int(differences.argmin())
        surface, _ = back_project(self.model["targets"][nearest].astype(np.float32), half_width=1.0)
        return CanonicalForm(
            surface.vertices / surface.area**0.5, surface.faces, {"neighbour": nearest}
        )

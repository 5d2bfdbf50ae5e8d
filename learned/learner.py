"""Base classes of methods with a trained network, and of those that read depth images."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    Interval,
    Matches,
    MethodInfo,
    Shape,
    UnsupportedShape,
)
from benchmark.api.learning import Split, read_card
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh

if TYPE_CHECKING:
    from torch import Tensor

    from benchmark.geometry.depth import DepthImage

LARGEST_SEED = 2**63 - 1
"""Largest seed that torch accepts."""


@dataclass(frozen=True, kw_only=True)
class TrainedMethod(CheckedParameters):
    """A method whose forms come from a trained network.

    Parameters
    ----------
    configuration
        Name of the network.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data; "" for that of the table.

    Attributes
    ----------
    model
        Folder of the loaded model; not a parameter, because the harness loads the model that fits each shape.
    """

    info: ClassVar[MethodInfo]
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")
    default_training: ClassVar[str]
    """Training data of the model to use if no table chooses one."""

    configuration: str
    training_seed: Annotated[int, Interval(0, LARGEST_SEED)] = 0
    training: Annotated[str, Matches("[A-Za-z0-9-]*", "a name of letters, digits and hyphens")] = ""
    model: Path | None = field(default=None, init=False)

    @property
    def model_name(self) -> str:
        """Configuration and training seed."""
        return f"{self.configuration}-seed{self.training_seed}"

    @property
    def model_folder(self) -> Path:
        """Folder of the loaded model, or else of the shipped one."""
        return self.model or self.shipped_models / (self.training or self.default_training) / self.model_name

    @abstractmethod
    def configuration_in(self, card: Mapping[str, Any], folder: Path) -> str:
        """Return the name of the network on the card of the model in ``folder``, or raise ``ConfigurationError``."""

    @abstractmethod
    def check_weights(self, folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the weights in ``folder`` are intact and match its card."""

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the card of the model in ``folder`` has this configuration."""
        name = self.configuration_in(card, folder)
        if name != self.configuration:
            raise ConfigurationError(
                f"the model in {folder} holds '{name}', not '{self.configuration}'", "name the folder of another model"
            )

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``.

        Raises
        ------
        ConfigurationError
            If the weights are damaged, have another digest than their card says, or belong to another configuration.
        """
        self.check_card(read_card(folder), folder)
        self.check_weights(folder)
        loaded = copy(self)
        object.__setattr__(loaded, "model", folder)
        return loaded


@dataclass(frozen=True, kw_only=True)
class StreamLearner(TrainedMethod):
    """A network trained on a stream of fresh bodies; see :class:`TrainedMethod` for its parameters."""

    kind: ClassVar[str]
    """Kind of its models, the first word of their names."""
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-varied"

    training: Annotated[str, Matches("[A-Za-z0-9-]+", "a name of letters, digits and hyphens")] = default_training

    @property
    def model_name(self) -> str:
        """Kind, configuration and training seed."""
        return f"{self.kind}-{self.configuration}-seed{self.training_seed}"


@dataclass(frozen=True, kw_only=True)
class DepthImageLearner(TrainedMethod):
    """Canonical form of a depth image by a trained network; see :class:`TrainedMethod` for its parameters."""

    usual_blur: ClassVar[float] = math.inf
    """Outline width in pixels that 90 % of the validation images of the shipped model do not exceed, if known."""

    @abstractmethod
    def mask(self, depth: DepthImage) -> Tensor:
        """Predict the mask, shape (r, r), with values from 0 to 1."""

    def measure_fit(self, shape: Shape) -> dict[str, float | str]:
        """Return the width of the predicted outline in pixels, and a doubt if it is unusual.

        See :class:`benchmark.api.learning.MeasuresFit` and :func:`learned.images.outline_blur`.
        """
        from learned.images import outline_blur

        if shape.depth is None:
            return {}
        notes: dict[str, float | str] = {"outline_blur": (blur := outline_blur(self.mask(shape.depth)))}
        if blur > self.usual_blur and self.model_folder.is_relative_to(self.shipped_models):
            usual = f"90 % of validation images have at most {self.usual_blur:g}"
            notes["doubt"] = f"the predicted outline is {blur:.2f} pixels wide ({usual}), so the form may not fit"
        return notes

    @abstractmethod
    def predict(self, depth: DepthImage) -> tuple[Mesh, dict[str, float | str]]:
        """Return the surface of unit area behind the predicted images, and notes about it."""

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Predict the canonical pose and return its surface, of unit area.

        Raises
        ------
        UnsupportedShape
            If there is no depth image, it is empty, or the network predicts nothing.
        InvalidMesh
            If the image has another size or holds values outside [0, 1].
        ConfigurationError
            If there is no model.
        """
        if shape.depth is None:
            raise UnsupportedShape("the learned network needs a depth image", "use the view input")
        surface, notes = self.predict(shape.depth)
        return CanonicalForm(surface.vertices, surface.faces, notes)

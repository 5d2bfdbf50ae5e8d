"""The learned rows of the tables: a depth image goes in, the predicted image of the canonical pose is the form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from benchmark.contracts import (
    CanonicalForm,
    CheckedParameters,
    Interval,
    Matches,
    MethodInfo,
    OneOf,
    Shape,
    UnsupportedShape,
)
from benchmark.errors import ConfigurationError
from benchmark.learning import Split, TrainingData, read_card
from learned.configuration import CONFIGURATIONS

ConfigurationName = Annotated[str, OneOf(CONFIGURATIONS.keys())]

MOST_SMOOTHING = 50.0
"""Beyond this a body of the size of the frame would lose all relief."""

LARGEST_SEED = 2**63 - 1
"""Largest seed that torch takes."""


@dataclass(frozen=True, kw_only=True)
class Learned(CheckedParameters):
    """Depth image of the canonical pose, predicted from a depth image by a convolutional network, and back-projected.

    "Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic Vision and SLAM-Aware
    Perception", section III; see :mod:`learned.network`.

    Parameters
    ----------
    configuration
        Name of the network; see :mod:`learned.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data; "" takes what the table says.
    smoothing
        Standard deviation, in pixels of the network, of a Gaussian that smooths the predicted depth inside the mask.
        The paper has none; a schedule shorter than the paper's leaves noise that this takes away.
    jump
        Depth discontinuity at which the predicted surface is cut: the largest depth difference along one of its edges,
        as a share of half the frame (the view input has 0.05). None: the predicted mask alone says what is surface.

    Attributes
    ----------
    model
        Folder of the model that was loaded; no parameter, for the harness loads the one that fits each shape.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="learned",
        title="Our",
        cite="canonicalreconstruction",
        family="paper",
        summary="canonical pose predicted from the depth image by the paper's network",
        requires=("torch", "safetensors"),
        inputs=("view",),
        scale="invariant",
    )
    split: ClassVar[Split] = "table"
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")
    default_training: ClassVar[str] = "humans-fold-0"
    """Training data of the model that is used where no table chooses one."""

    configuration: ConfigurationName = "literal"
    training_seed: Annotated[int, Interval(0, LARGEST_SEED)] = 0
    training: Annotated[str, Matches("[A-Za-z0-9-]*", "a name of letters, digits and hyphens")] = ""
    smoothing: Annotated[float, Interval(0, MOST_SMOOTHING)] = 0.0
    jump: Annotated[float, Interval(0, closed="neither")] | None = None
    model: Path | None = field(default=None, init=False)

    @property
    def model_name(self) -> str:
        """Configuration and training seed."""
        return f"{self.configuration}-seed{self.training_seed}"

    @property
    def model_folder(self) -> Path:
        """Folder of the model: the one that was loaded, else the shipped one."""
        return self.model or self.shipped_models / (self.training or self.default_training) / self.model_name

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`benchmark.learning.Learner` and :class:`learned.schedule.Schedule`."""
        from learned.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.learning.ChecksOptions`."""
        from learned.fitting import checked_options

        checked_options(self.configuration, options)

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the card of the model in ``folder`` is one of this configuration."""
        from learned.card import network_of

        found = network_of(card, folder).configuration.name
        if found != self.configuration:
            raise ConfigurationError(
                f"the model in {folder} holds '{found}', not '{self.configuration}'", "name the folder of another model"
            )

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``.

        Raises
        ------
        ConfigurationError
            If the weights are damaged, have another digest than their card says, or belong to another configuration.
        """
        from learned.model import load_model

        self.check_card(read_card(folder), folder)
        load_model(folder)
        loaded = copy(self)
        object.__setattr__(loaded, "model", folder)
        return loaded

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Predict the canonical depth image and return the surface behind it, of unit area.

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
        from learned.prediction import canonical_surface

        surface, notes = canonical_surface(self.model_folder, shape.depth, self.smoothing, self.jump)
        return CanonicalForm(surface.vertices, surface.faces, notes)


@dataclass(frozen=True, kw_only=True)
class WithoutSRF(Learned):
    """The network without short-range features (Table IV)."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info, name="learned-without-srf", title="w/o SRF", family="extended", summary="ablation: no SRF"
    )
    configuration: ConfigurationName = "without_srf"


@dataclass(frozen=True, kw_only=True)
class WithoutLRF(Learned):
    """The network without long-range features (Table IV)."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info, name="learned-without-lrf", title="w/o LRF", family="extended", summary="ablation: no LRF"
    )
    configuration: ConfigurationName = "without_lrf"


@dataclass(frozen=True, kw_only=True)
class Strict(Learned):
    """The network tested on subjects and poses that it has never seen (Table IV)."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-strict",
        title="strict train",
        family="extended",
        summary="ablation: neither subject nor pose seen in training, 12 folds",
    )
    split: ClassVar[Split] = "strict"


@dataclass(frozen=True, kw_only=True)
class Wide(Learned):
    """A network in which each output pixel sees the whole image."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-wide",
        title="Our, wide",
        family="extended",
        summary="two convolutions a block and global context",
    )
    configuration: ConfigurationName = "wide"


@dataclass(frozen=True, kw_only=True)
class WideExtra(Learned):
    """A network with one global code, trained on sampled bodies."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-wide-extra",
        title="Our, wide, extra training data",
        family="extended",
        summary="one global code, trained on sampled bodies",
    )
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-sampled"
    configuration: ConfigurationName = "wide-extra"

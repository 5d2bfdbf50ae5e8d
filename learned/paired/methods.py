"""Learned rows of the tables, whose form is the depth image of the canonical pose predicted from a depth image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from benchmark.api.contracts import Interval, MethodInfo, OneOf
from benchmark.api.learning import Split, TrainingData
from benchmark.geometry.mesh import Mesh
from learned.learner import DepthImageLearner
from learned.paired.configuration import CONFIGURATIONS

if TYPE_CHECKING:
    from torch import Tensor

    from benchmark.geometry.depth import DepthImage

ConfigurationName = Annotated[str, OneOf(CONFIGURATIONS.keys())]

MOST_SMOOTHING = 50.0
"""Largest smoothing; with more, a body of the size of the frame would lose all relief."""


@dataclass(frozen=True, kw_only=True)
class Learned(DepthImageLearner):
    """Depth image of the canonical pose, predicted from a depth image by a convolutional network, and back-projected.

    "Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic Vision and SLAM-Aware
    Perception", section III; see :mod:`learned.paired.network`.

    Parameters
    ----------
    configuration
        Name of the network; see :mod:`learned.paired.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data; "" for that of the table.
    smoothing
        Standard deviation, in pixels of the network, of a Gaussian that smooths the predicted depth inside the mask.
        The paper has none; a schedule shorter than the paper's leaves noise, which smoothing removes.
    jump
        Depth discontinuity at which the predicted surface is cut: the largest depth difference along an edge, as a
        share of half the frame (0.05 for the view input). None: the predicted mask alone defines the surface.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="learned",
        title="Our",
        cite="canonicalreconstruction",
        family="paper",
        summary="canonical pose predicted from the depth image by the paper's network",
        departs=(
            "One sentence of the source gives each of nine short-range blocks a convolution and a transposed one; "
            "here five have the former, four the latter. Widths, output functions, camera and canonical pose, which "
            "it leaves open, are ours, and so are, unless 'as_printed', fewer pixels and, for people, epochs."
        ),
        requires=("torch", "safetensors"),
        inputs=("view",),
        scale="invariant",
    )
    split: ClassVar[Split] = "table"
    default_training: ClassVar[str] = "humans-fold-0"

    configuration: ConfigurationName = "literal"
    smoothing: Annotated[float, Interval(0, MOST_SMOOTHING)] = 0.0
    jump: Annotated[float, Interval(0, closed="neither")] | None = None

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`.Learner` and :class:`learned.paired.schedule.Schedule`."""
        from learned.paired.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.api.learning.ChecksOptions`."""
        from learned.paired.fitting import checked_options

        checked_options(self.configuration, options)

    def configuration_in(self, card: Mapping[str, Any], folder: Path) -> str:
        """See :meth:`learned.learner.DepthImageLearner.configuration_in`."""
        from learned.paired.card import network_of

        return network_of(card, folder).configuration.name

    def check_weights(self, folder: Path) -> None:
        """See :meth:`learned.learner.DepthImageLearner.check_weights`."""
        from learned.paired.model import load_model

        load_model(folder)

    def mask(self, depth: DepthImage) -> Tensor:
        """See :meth:`learned.learner.DepthImageLearner.mask`."""
        from learned.paired.model import prediction

        return prediction(self.model_folder, depth)[-1]

    def predict(self, depth: DepthImage) -> tuple[Mesh, dict[str, float | str]]:
        """See :meth:`learned.learner.DepthImageLearner.predict`."""
        from learned.paired.model import canonical_surface

        return canonical_surface(self.model_folder, depth, self.smoothing, self.jump)


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
class WithoutWeighting(Learned):
    """The network trained with the final weight of the depth loss throughout (Table IV)."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-without-weighting",
        title="w/o progressive weighting",
        family="extended",
        summary="ablation: the weight of the depth loss is 1 from the first epoch",
    )
    configuration: ConfigurationName = "without_weighting"


@dataclass(frozen=True, kw_only=True)
class SizeFree(Learned):
    """The network with images and targets cropped to the body, so that its size is unknown."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-size-free",
        title="Our, size unknown",
        family="extended",
        summary="the paper's network without the size of the body",
        departs="Images are cropped to the body, whose size is therefore unknown. Otherwise it departs as 'Our' does.",
    )
    configuration: ConfigurationName = "size_free"


@dataclass(frozen=True, kw_only=True)
class Strict(Learned):
    """The network tested on subjects and poses not seen in training (Table IV)."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-strict",
        title="strict train",
        family="extended",
        summary="ablation: neither subject nor pose seen in training, 12 folds",
    )
    split: ClassVar[Split] = "strict"


@dataclass(frozen=True, kw_only=True)
class WideExtra(Learned):
    """A network with one global code, trained on sampled bodies."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-wide-extra",
        title="Our, wide, extra training data",
        family="extended",
        summary="one global code, trained on sampled bodies",
        departs="Another network: an encoder to one code and a decoder from it, trained on sampled bodies.",
    )
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-sampled"
    configuration: ConfigurationName = "wide-extra"

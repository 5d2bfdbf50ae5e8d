"""Methods with a trained network: the learned rows of the tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

from benchmark.api.contracts import (
    CanonicalForm,
    CheckedParameters,
    Interval,
    Matches,
    MethodInfo,
    Shape,
    UnsupportedShape,
)
from benchmark.api.learning import Split, TrainingData
from benchmark.errors import ConfigurationError

if TYPE_CHECKING:
    from torch import Tensor

    from benchmark.geometry.depth import DepthImage

ConfigurationName = Literal[
    "literal",
    "as_printed",
    "without_srf",
    "without_lrf",
    "without_weighting",
    "size_free",
    "wide-extra",
    "streamed-people",
    "field-plain",
]
"""A key of ``learned.models.CONFIGURATIONS``, whose import takes a second."""

#: Depth inside the predicted mask.
Relief = Literal["predicted", "average", "flat"]


@dataclass(frozen=True, kw_only=True)
class TrainedNetwork(CheckedParameters):
    """A method whose forms come from a trained network.

    Parameters
    ----------
    configuration
        Name of the network; see :data:`learned.models.CONFIGURATIONS`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data; "" for that of the table.

    Attributes
    ----------
    model
        Folder of the loaded model; not a parameter, because the harness loads the model that fits
        each shape.
    """

    info: ClassVar[MethodInfo]
    split: ClassVar[Split] = "table"
    shipped_models: ClassVar[Path] = Path(__file__).with_name("models")
    default_training: ClassVar[str] = "people-fold-0"
    """Training data of the model to use if no table chooses one."""

    configuration: ConfigurationName
    training_seed: Annotated[int, Interval(0, 2**63 - 1)] = 0
    training: Annotated[str, Matches("[A-Za-z0-9-]*", "a name of letters, digits and hyphens")] = ""
    model: Path | None = field(default=None, init=False)

    @property
    def model_name(self) -> str:
        """Configuration and training seed."""
        return f"{self.configuration}-seed{self.training_seed}"

    @property
    def model_folder(self) -> Path:
        """Folder of the loaded model, or else of the shipped one."""
        if self.model:
            return self.model
        return self.shipped_models / (self.training or self.default_training) / self.model_name

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``.

        Raises
        ------
        ConfigurationError
            If the weights are damaged, have another digest than their card says, or belong to
            another configuration.
        """
        from learned.models import load_model

        _, card = load_model(folder)
        name = card.configuration.name
        if name != self.configuration:
            problem = f"the model in {folder} holds '{name}', not '{self.configuration}'"
            raise ConfigurationError(problem, "name the folder of another model")
        loaded = copy(self)
        object.__setattr__(loaded, "model", folder)
        return loaded

    def train(
        self,
        data: TrainingData,
        folder: Path,
        options: Mapping[str, Any],
        say: Callable[[str], None],
    ) -> None:
        """Train the model; see :class:`.Learner` and :class:`learned.training.Schedule`.

        Raises
        ------
        ConfigurationError
            If an option does not fit, or the folder holds a finished model of another training.
        TrainingError
            If training cannot continue.
        """
        from learned.fitting import train

        train(self.configuration, self.training_seed, data, folder, options, say)

    def seeds(self, training: str) -> tuple[int, ...]:
        """Return the seeds of the models of tables; see :class:`.HasRecipe`."""
        is_single = self.configuration in ("as_printed", "size_free", "wide-extra")
        return (0,) if is_single or training.endswith("-III") else (0, 1)

    def recipe(self, training: str) -> dict[str, Any]:
        """Return the options of their training."""
        if self.configuration in ("as_printed", "wide-extra"):  # their defaults
            return {}
        epochs = 500 if training.endswith("-III") else 60
        return {"resolution": 128, "stretch_depth": True, "epochs": epochs}

    def training_seconds(self, training: str, n_pairs: int) -> float:
        """Return about how many seconds a core takes for one of them, on so many pairs."""
        from learned.fitting import estimated_seconds

        return estimated_seconds(self.configuration, n_pairs, self.recipe(training))


@dataclass(frozen=True, kw_only=True)
class Learned(TrainedNetwork):
    """Depth image of the canonical pose, predicted by a convolutional network, and back-projected.

    "Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic
    Vision and SLAM-Aware Perception", section III; see :mod:`learned.paper_network`.

    Parameters
    ----------
    configuration
        Name of the network; see :data:`learned.models.CONFIGURATIONS`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data; "" for that of the table.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="learned",
        title="Depth network",
        cite="canonicalreconstruction",
        family="paper",
        summary=(
            "Sees one depth image, and predicts that of the same body in a pose that all shapes "
            "share."
        ),
        departs=(
            "The source counts the short-range blocks in three ways; here they are nine "
            "convolutions. Widths, the slope of LeakyReLU (.2), initial weights (He et al. 2015), "
            "output functions, range of depths, camera and canonical pose, which it leaves open, "
            "are ours. It is trained in bfloat16, for Table II on ten instead of fifteen subjects, "
            "and, unless 'as_printed' is chosen, with fewer pixels, with target depths that are "
            "stretched over the range, and, on people, with fewer epochs."
        ),
        requires=("torch", "safetensors"),
        inputs=("view",),
        scale="invariant",
    )
    usual_blur: ClassVar[float] = math.inf
    """Width in pixels of outlines of validation images, which 90 % do not exceed, if known."""

    relief: ClassVar[Relief] = "predicted"
    """Depth inside the predicted mask: the predicted one, or, in controls, that of the average
    training body (of folds of people, at 128 x 128 pixels), or none.
    """

    configuration: ConfigurationName = "literal"

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Predict the canonical pose and return its surface, of unit area.

        Its notes say how wide the predicted outline is in pixels, and a doubt if that is unusual;
        see :func:`learned.images.outline_blur`.

        Raises
        ------
        UnsupportedShape
            If there is no depth image, it is empty, or the network predicts nothing.
        InvalidMesh
            If the image has another size or holds values outside [0, 1].
        ConfigurationError
            If there is no model.
        """
        import torch

        from learned.images import enlarged
        from learned.surface import closed_surface, open_surface

        if shape.depth is None:
            raise UnsupportedShape("the learned network needs a depth image", "use the view input")
        *depths, mask = self.predict(shape.depth)
        front, *back = (enlarged(torch.stack([depth, mask])) for depth in depths)
        surface, notes = closed_surface(front, back[0]) if back else open_surface(front)
        return CanonicalForm(surface.vertices, surface.faces, {**notes, **self._fit(mask)})

    def predict(self, depth: DepthImage) -> Tensor:
        """Predict the depths and the mask of the canonical pose from a depth image.

        A control uses the predicted mask, but other depths: those of the average body, or 0.5.

        Parameters
        ----------
        depth
            Depth image, shape (500, 500).

        Returns
        -------
        torch.Tensor
            Depth of each side of the body, and then the mask, shape (sides + 1, r, r).
        """
        import torch

        from learned.models import average_body, predict

        prediction = predict(self.model_folder, depth)
        if self.relief == "predicted":
            return prediction
        # A flat relief lies in the middle of the frame.
        mask = prediction[-1]
        relief = mask * 0 + 0.5
        if self.relief == "average":
            relief = average_body(self.model_folder, len(mask))
        return torch.stack([relief, mask])

    def _fit(self, mask: Tensor) -> dict[str, float | str]:
        """Return the width of a predicted outline in pixels, and a doubt if it is unusual."""
        from learned.images import outline_blur

        blur = outline_blur(mask)
        if blur <= self.usual_blur or not self.model_folder.is_relative_to(self.shipped_models):
            return {"outline_blur": blur}
        usual = f"90 % of validation images have at most {self.usual_blur:g}"
        doubt = (
            f"the predicted outline is {blur:.2f} pixels wide ({usual}), so the form may not fit"
        )
        return {"outline_blur": blur, "doubt": doubt}


@dataclass(frozen=True, kw_only=True)
class WithoutSRF(Learned):
    """The paper's network without its short-range features."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-without-srf",
        title="w/o SRF",
        family="extended",
        summary="ablation: no SRF",
    )

    configuration: ConfigurationName = "without_srf"


@dataclass(frozen=True, kw_only=True)
class WithoutLRF(Learned):
    """The paper's network without its long-range features."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-without-lrf",
        title="w/o LRF",
        family="extended",
        summary="ablation: no LRF",
    )

    configuration: ConfigurationName = "without_lrf"


@dataclass(frozen=True, kw_only=True)
class WithoutWeighting(Learned):
    """The paper's network, trained without progressive weighting of the losses."""

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
    """The paper's network on images that are cropped to the body, whose size it does not know."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-size-free",
        title="Depth network, size unknown",
        family="extended",
        summary="the paper's network without the size of the body",
        departs=(
            "Images are cropped to the body, so its size is unknown, and how large it appears "
            "depends on its pose. Otherwise, it departs like 'learned'."
        ),
    )

    configuration: ConfigurationName = "size_free"


@dataclass(frozen=True, kw_only=True)
class Strict(Learned):
    """The paper's network, tested on subjects and poses that its training has not seen."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-strict",
        title="strict train",
        family="extended",
        summary=(
            "ablation: neither subject nor pose seen in training; four models, each of 15 of 20 "
            "poses, make the forms of a gallery"
        ),
    )
    split: ClassVar[Split] = "strict"


@dataclass(frozen=True, kw_only=True)
class Average(Learned):
    """A control of the paper's network: its mask, with the depths of the average training body."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-average",
        title="Average body in the predicted mask",
        family="extended",
        summary="control: the depth is not that of the body",
        departs="A control: only the mask is predicted.",
        files=("models/average-bodies.safetensors",),
    )

    relief: ClassVar[Relief] = "average"


@dataclass(frozen=True, kw_only=True)
class Flat(Learned):
    """A control of the paper's network: its mask, without any depths."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-flat",
        title="Flat in the predicted mask",
        family="extended",
        summary="control: no depth",
        departs="A control: only the mask is predicted.",
    )

    relief: ClassVar[Relief] = "flat"


@dataclass(frozen=True, kw_only=True)
class WideExtra(Learned):
    """A network with one code for the whole image, trained on bodies drawn at random."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-wide-extra",
        title="Depth network, extra data",
        family="extended",
        summary="one global code, trained on sampled bodies",
        departs=(
            "Another network: an encoder to one code and a decoder from it, trained on sampled "
            "bodies."
        ),
        cite="",
    )
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-sampled"

    configuration: ConfigurationName = "wide-extra"


@dataclass(frozen=True, kw_only=True)
class Streamed(Learned):
    """A network with one code for the whole image, trained on a stream of new bodies."""

    info: ClassVar[MethodInfo] = replace(
        Learned.info,
        name="learned-streamed",
        title="Depth network, streamed",
        family="extended",
        summary="one code, trained on fresh bodies in free poses, blind to the frame",
        departs=(
            "Another network: one code for the whole image, which is cropped to the body. It "
            "predicts front and back, and was trained on generated bodies, none of them twice."
        ),
        cite="",
    )
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-varied"
    usual_blur: ClassVar[float] = 2.29

    configuration: ConfigurationName = "streamed-people"


@dataclass(frozen=True, kw_only=True)
class DeformationField(TrainedNetwork):
    """Vertices at the canonical positions that a network predicts, with the detail of the input.

    The network maps a position and a code of the whole surface to the position in the canonical
    pose, like the deformation fields of DIF-Net [Deng et al. 2021] and Deform2NeRF. An
    as-rigid-as-possible deformation then follows the prediction; see :mod:`learned.field`.

    Parameters
    ----------
    configuration
        Name of the field.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.
    reach
        Length, in units of sqrt(area), up to which details come from the input; 0 keeps the
        predicted positions.
    rounds
        Rounds of fitting rotations to the form, after the predicted rotations were used.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="deformation-field",
        title="Deformation Field, extra training data",
        cite="deng2021deformed",
        family="extended",
        summary=(
            "Predicts by a network where each point of a complete surface lies in a pose that "
            "all people share."
        ),
        departs=(
            "A network of our own: the source deforms a template's distance field, here a field "
            "moves the vertices of the input, and an energy that is as rigid as possible keeps "
            "their detail."
        ),
        requires=("torch", "safetensors"),
        inputs=("mesh",),
        scale="invariant",
    )
    split: ClassVar[Split] = "sampled"
    default_training: ClassVar[str] = "humans-varied"

    configuration: ConfigurationName = "field-plain"
    reach: Annotated[float, Interval(0, 10)] = 0.1
    rounds: Annotated[int, Interval(0, 100)] = 3

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the vertices in the canonical pose, of unit area.

        Raises
        ------
        UnsupportedShape
            If the surface has no area or too many vertices, or its form would have no area.
        ConfigurationError
            If there is no model.
        """
        from learned.field import form_of
        from learned.models import load_model

        network, _ = load_model(self.model_folder)
        vertices, notes = form_of(cast(Any, network), shape, self.reach, self.rounds)
        return shape.form(vertices, **notes)

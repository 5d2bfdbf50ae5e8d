"""The row of the streamed networks: one depth image goes in, the canonical form comes out, of any body in any frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
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
from learned.streamed.configuration import STREAMED


@dataclass(frozen=True, kw_only=True)
class StreamedLearner(CheckedParameters):
    """Depth image of the canonical pose from one code, by a network that was trained on fresh bodies without end.

    Parameters
    ----------
    configuration
        Name of the network; see :mod:`learned.streamed.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.

    Attributes
    ----------
    model
        Folder of the model that was loaded; no parameter, for the harness loads it.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="learned-streamed",
        title="Our, streamed, extra training data",
        cite="canonicalreconstruction",
        family="extended",
        summary="one code, trained on fresh bodies in free poses, blind to the frame",
        requires=("torch", "safetensors"),
        inputs=("view",),
        scale="invariant",
    )
    split: ClassVar[Split] = "sampled"
    shipped_models: ClassVar[Path] = Path(__file__).parents[1] / "models"

    configuration: Annotated[str, OneOf(STREAMED.keys())] = "plain"
    training_seed: Annotated[int, Interval(0, 2**63 - 1)] = 0
    training: Annotated[str, Matches("[A-Za-z0-9-]+", "a name of letters, digits and hyphens")] = "humans-varied"
    model: Path | None = field(default=None, init=False)

    @property
    def model_name(self) -> str:
        """Configuration and training seed."""
        return f"streamed-{self.configuration}-seed{self.training_seed}"

    @property
    def model_folder(self) -> Path:
        """Folder of the model: the one that was loaded, else the shipped one."""
        return self.model or self.shipped_models / self.training / self.model_name

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`learned.streamed.training.Plan`."""
        from learned.streamed.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.learning.ChecksOptions`."""
        from learned.streamed.fitting import checked_plan

        checked_plan(self.configuration, options)

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the card of the model in ``folder`` is one of this configuration."""
        from learned.streamed.model import configuration_of

        found = configuration_of(card, folder).name
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
        from learned.streamed.model import load_streamed

        self.check_card(read_card(folder), folder)
        load_streamed(folder)
        loaded = copy(self)
        object.__setattr__(loaded, "model", folder)
        return loaded

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Predict the canonical pose and return the surface behind it, of unit area.

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
        from learned.streamed.model import form_of, load_streamed, predicted

        surface, notes = form_of(predicted(*load_streamed(self.model_folder), shape.depth))
        return CanonicalForm(surface.vertices, surface.faces, notes)

"""The row of the template: a closed surface goes in, and comes out deformed into the space of all shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from benchmark.contracts import CanonicalForm, CheckedParameters, Interval, Matches, MethodInfo, OneOf, Shape
from benchmark.errors import ConfigurationError
from benchmark.learning import Split, TrainingData, read_card
from learned.learner import LARGEST_SEED
from learned.template.configuration import TEMPLATES


@dataclass(frozen=True, kw_only=True)
class ImplicitTemplate(CheckedParameters):
    """Surface in the space of a learned template, into which the deformation field of its code moves each vertex.

    Parameters
    ----------
    configuration
        Name of the model; see :mod:`learned.template.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.

    Attributes
    ----------
    model
        Folder of the model that was loaded; no parameter, for the harness loads the one that fits each shape.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="implicit-template",
        title="Deformed Implicit Field, extra training data",
        cite="deng2021deformed",
        family="extended",
        summary="deformed into the signed distance field of one template, by a code that is searched for each shape",
        requires=("torch", "safetensors", "igl"),
        inputs=("mesh",),
        scale="invariant",
    )
    split: ClassVar[Split] = "sampled"
    shipped_models: ClassVar[Path] = Path(__file__).parents[1] / "models"
    default_training: ClassVar[str] = "humans-varied"

    configuration: Annotated[str, OneOf(TEMPLATES.keys())] = "plain"
    training_seed: Annotated[int, Interval(0, LARGEST_SEED)] = 0
    training: Annotated[str, Matches("[A-Za-z0-9-]+", "a name of letters, digits and hyphens")] = default_training
    model: Path | None = field(default=None, init=False)

    @property
    def model_name(self) -> str:
        """Configuration and training seed."""
        return f"template-{self.configuration}-seed{self.training_seed}"

    @property
    def model_folder(self) -> Path:
        """Folder of the model: the one that was loaded, else the shipped one."""
        return self.model or self.shipped_models / self.training / self.model_name

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`learned.steps.Plan`."""
        from learned.template.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.learning.ChecksOptions`."""
        from learned.template.fitting import checked_plan

        checked_plan(self.configuration, options)

    def check_card(self, card: Mapping[str, Any], folder: Path) -> None:
        """Raise ``ConfigurationError`` unless the card of the model in ``folder`` is one of this configuration."""
        from learned.template.model import configuration_of

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
        from learned.template.model import load_template

        self.check_card(read_card(folder), folder)
        load_template(folder)
        loaded = copy(self)
        object.__setattr__(loaded, "model", folder)
        return loaded

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Search the code of the shape, and return its vertices in the space of the template, of unit area.

        Raises
        ------
        UnsupportedShape
            If there is no surface, or it encloses nothing.
        ConfigurationError
            If there is no model.
        """
        from learned.template.model import deformed, load_template

        vertices, notes = deformed(*load_template(self.model_folder), shape.mesh)
        return shape.form(vertices, **notes)

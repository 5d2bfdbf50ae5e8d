"""The row of the template: a closed surface goes in, and comes out deformed into the space of all shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from benchmark.api.contracts import CanonicalForm, MethodInfo, OneOf, Shape
from benchmark.api.learning import TrainingData
from learned.learner import StreamLearner
from learned.template.configuration import TEMPLATES


@dataclass(frozen=True, kw_only=True)
class ImplicitTemplate(StreamLearner):
    """Surface in the space of a learned template, into which the deformation field of its code moves each vertex.

    Parameters
    ----------
    configuration
        Name of the model; see :mod:`learned.template.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.
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
    kind: ClassVar[str] = "template"

    configuration: Annotated[str, OneOf(TEMPLATES.keys())] = "plain"

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`learned.template.training.TemplatePlan`."""
        from learned.template.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.api.learning.ChecksOptions`."""
        from learned.template.fitting import checked_plan

        checked_plan(self.configuration, options)

    def configuration_in(self, card: Mapping[str, Any], folder: Path) -> str:
        """See :meth:`learned.learner.TrainedMethod.configuration_in`."""
        from learned.template.model import configuration_of

        return configuration_of(card, folder).name

    def check_weights(self, folder: Path) -> None:
        """See :meth:`learned.learner.TrainedMethod.check_weights`."""
        from learned.template.model import load_template

        load_template(folder)

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

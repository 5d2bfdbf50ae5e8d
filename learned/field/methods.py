"""Row of the deformation field, which deforms a complete surface into the canonical pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from benchmark.api.contracts import CanonicalForm, Interval, MethodInfo, OneOf, Shape
from benchmark.api.learning import TrainingData
from learned.field.configuration import FIELDS
from learned.learner import StreamLearner

MOST_ROUNDS = 100
"""Largest number of rounds; more would change nothing that the scorer sees."""


@dataclass(frozen=True, kw_only=True)
class DeformationField(StreamLearner):
    """Vertices at the canonical positions that a network predicts, with the detail of the input.

    The network maps a position and a code of the whole surface to the position in the canonical pose, like the
    deformation fields of DIF-Net [Deng et al. 2021] and Deform2NeRF. An as-rigid-as-possible deformation then follows
    the prediction; see :mod:`learned.field`.

    Parameters
    ----------
    configuration
        Name of the field; see :mod:`learned.field.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.
    reach
        Length, in units of sqrt(area), up to which details come from the input; 0 keeps the predicted positions.
    rounds
        Rounds of fitting rotations to the form, after the predicted rotations were used.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="deformation-field",
        title="Deformation Field, extra training data",
        cite="deng2021deformed",
        family="extended",
        summary="canonical positions of all vertices by a network, trained on fresh bodies",
        departs=(
            "A network of our own: the source deforms a template's distance field, here a field moves the vertices of "
            "the input, and an energy that is as rigid as possible keeps their detail."
        ),
        requires=("torch", "safetensors"),
        inputs=("mesh",),
        scale="invariant",
    )
    kind: ClassVar[str] = "field"

    configuration: Annotated[str, OneOf(FIELDS.keys())] = "plain"
    reach: Annotated[float, Interval(0, 10)] = 0.1
    rounds: Annotated[int, Interval(0, MOST_ROUNDS)] = 3

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`learned.field.training.FieldPlan`."""
        from learned.field.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.api.learning.ChecksOptions`."""
        from learned.field.fitting import checked_plan

        checked_plan(self.configuration, options)

    def configuration_in(self, card: Mapping[str, Any], folder: Path) -> str:
        """See :meth:`learned.learner.TrainedMethod.configuration_in`."""
        from learned.field.model import configuration_of

        return configuration_of(card, folder).name

    def check_weights(self, folder: Path) -> None:
        """See :meth:`learned.learner.TrainedMethod.check_weights`."""
        from learned.field.model import load_field

        load_field(folder)

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the vertices in the canonical pose, of unit area.

        Raises
        ------
        UnsupportedShape
            If the surface has no area or too many vertices, or its form would have no area.
        ConfigurationError
            If there is no model.
        """
        from learned.field.model import form_of, load_field

        vertices, notes = form_of(load_field(self.model_folder), shape, self.reach, self.rounds)
        return shape.form(vertices, **notes)

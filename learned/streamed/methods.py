"""Row of the streamed networks, which predict the canonical form from one depth image, of any body in any frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from benchmark.api.contracts import MethodInfo, OneOf
from benchmark.api.learning import TrainingData
from benchmark.geometry.mesh import Mesh
from learned.learner import DepthImageLearner, StreamLearner
from learned.streamed.configuration import STREAMED

if TYPE_CHECKING:
    from torch import Tensor

    from benchmark.geometry.depth import DepthImage


@dataclass(frozen=True, kw_only=True)
class StreamedLearner(StreamLearner, DepthImageLearner):
    """Depth image of the canonical pose from one code, by a network trained on an endless stream of bodies.

    Parameters
    ----------
    configuration
        Name of the network; see :mod:`learned.streamed.configuration`.
    training_seed
        Seed of the training whose model is used.
    training
        Name of the training data.
    """

    info: ClassVar[MethodInfo] = MethodInfo(
        name="learned-streamed",
        title="Our, streamed, extra training data",
        cite="canonicalreconstruction",
        family="extended",
        summary="one code, trained on fresh bodies in free poses, blind to the frame",
        departs="Another network: one code for the whole image, trained on generated bodies without end.",
        requires=("torch", "safetensors"),
        inputs=("view",),
        scale="invariant",
    )
    kind: ClassVar[str] = "streamed"
    usual_blur: ClassVar[float] = 2.29

    configuration: Annotated[str, OneOf(STREAMED.keys())] = "people"

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train the model; see :class:`learned.training.loop.Plan`."""
        from learned.streamed.fitting import fit

        fit(self.configuration, self.training_seed, data, folder, options, say)

    def check_options(self, options: Mapping[str, Any]) -> None:
        """See :class:`benchmark.api.learning.ChecksOptions`."""
        from learned.streamed.fitting import checked_plan

        checked_plan(self.configuration, options)

    def configuration_in(self, card: Mapping[str, Any], folder: Path) -> str:
        """See :meth:`learned.learner.DepthImageLearner.configuration_in`."""
        from learned.streamed.model import configuration_of

        return configuration_of(card, folder).name

    def check_weights(self, folder: Path) -> None:
        """See :meth:`learned.learner.DepthImageLearner.check_weights`."""
        from learned.streamed.model import load_streamed

        load_streamed(folder)

    def mask(self, depth: DepthImage) -> Tensor:
        """See :meth:`learned.learner.DepthImageLearner.mask`."""
        from learned.streamed.model import load_streamed, predicted

        return predicted(*load_streamed(self.model_folder), depth)[-1]

    def predict(self, depth: DepthImage) -> tuple[Mesh, dict[str, float | str]]:
        """See :meth:`learned.learner.DepthImageLearner.predict`."""
        from learned.streamed.model import form_of, load_streamed, predicted

        return form_of(predicted(*load_streamed(self.model_folder), depth))

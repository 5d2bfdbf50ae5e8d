"""Contract of a method that learns: training pairs come in, a folder with a model goes out.

A *learner* is a method (see :mod:`benchmark.api.contracts`) that also has ``train`` and ``load``. The harness chooses
the training data by the protocol of a table, so that no learner ever sees a shape it is tested on, and hands the
learner the model that fits each shape.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, runtime_checkable

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape
from benchmark.errors import ConfigurationError

__all__ = [
    "CARD",
    "WEIGHTS",
    "ChecksOptions",
    "Learner",
    "MakesPairs",
    "MeasuresFit",
    "Split",
    "TrainingData",
    "TrainingPair",
    "card_digest",
    "checked_weights",
    "find_model",
    "read_card",
]

WEIGHTS = "weights.safetensors"
"""File of the weights in the folder of a model."""

CARD = "card.json"
"""File that tells what a model was trained on and how; it is written last, so its presence means a finished model."""

Split = Literal["table", "strict", "sampled"]
"""Which data trains a method: the training subjects of the table, folds over subjects and poses, or sampled bodies."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingPair:
    """A depth image of a subject in some pose, and the image of the same subject in the canonical pose.

    Parameters
    ----------
    identifier
        Name of the shape that the input shows.
    subject
        Its retrieval class.
    target_identifier
        Name of the shape that the target shows.
    image, target
        Depth images, shape (500, 500), float32 in [0, 1] with 0 as background; see
        :func:`benchmark.geometry.depth.render_depth`.
    """

    identifier: str
    subject: str
    target_identifier: str
    image: NDArray[np.float32]
    target: NDArray[np.float32]


class MakesPairs(Protocol):
    """Maker of fresh pairs, one at a time and always in the same order."""

    def __call__(self, start: int = 0) -> Iterator[TrainingPair]:
        """Make the pairs from a place on, without the work for those before it."""
        ...


@dataclass(frozen=True, kw_only=True)
class TrainingData:
    """The pairs that one protocol allows for training.

    Parameters
    ----------
    name
        Name of the protocol and folder of its models, e.g. ``"humans-fold-0"``.
    title
        The same in words, naming a stand-in as such.
    digest
        Names what determines the pairs.
    subjects
        Subjects that the pairs show.
    identifiers
        Every shape whose image training sees, as input or as target.
    n_pairs
        Number of pairs.
    clearance
        For each generated set of people, the distance in phenotype space that their bodies keep from all subjects of
        it that they are not; empty where no body has a phenotype.
    pairs
        Makes the pairs.
    unseen
        Makes pairs of test subjects, for curves and pictures; nothing is ever chosen by them. Where subjects are held
        back for validation, they are shown instead.
    """

    name: str
    title: str
    digest: str
    subjects: tuple[str, ...]
    identifiers: tuple[str, ...]
    n_pairs: int
    pairs: MakesPairs
    unseen: MakesPairs
    clearance: Mapping[str, float] = field(default_factory=dict)


@runtime_checkable
class Learner(Protocol):
    """A method whose forms come from a trained model.

    ``split`` says which data trains it, ``shipped_models`` is the folder of the models that come with the method. A
    learner may have a method ``check_card(card, folder)`` that raises ``ConfigurationError`` if the card is none of its
    own; it is called before any shape is processed, and must not load the weights.
    """

    info: ClassVar[MethodInfo]
    split: ClassVar[Split]
    shipped_models: ClassVar[Path]

    @property
    def model_name(self) -> str:
        """Folder of the model inside the folder of its training data; tells configuration and training seed."""
        ...

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train a model into ``folder``, going on from a checkpoint if there is one; a finished model is left alone.

        Parameters
        ----------
        data
            What to train on.
        folder
            Where checkpoint, weights, card and pictures go.
        options
            Deviations from the method's own schedule by name, as given on the command line.
        say
            Told about progress, one line at a time.
        """
        ...

    def load(self, folder: Path) -> Self:
        """Return the same method with the model in ``folder``; raises ``ConfigurationError`` if it does not fit."""
        ...

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the canonical form, or raise ``UnsupportedShape`` with the reason."""
        ...


@runtime_checkable
class ChecksOptions(Protocol):
    """A learner that can tell whether options fit it before its training data is made, which may take long."""

    def check_options(self, options: Mapping[str, Any]) -> None:
        """Raise ``ConfigurationError`` if an option does not fit, or this machine lacks what it asks for."""
        ...


@runtime_checkable
class MeasuresFit(Protocol):
    """A learner that can tell how well its form fits a depth image; ``canonicalise`` shows the result."""

    def measure_fit(self, shape: Shape) -> Mapping[str, float | str]:
        """Return notes on the fit; one called ``"doubt"`` is a warning."""
        ...


def find_model(folders: Iterable[Path], data_name: str, model_name: str) -> Path | None:
    """First folder that holds a finished model.

    Parameters
    ----------
    folders
        Where to look, in order: models trained here come before shipped ones.
    data_name
        Name of the training data.
    model_name
        :attr:`Learner.model_name`.
    """
    places = (folder / data_name / model_name for folder in folders)
    return next((place for place in places if (place / CARD).is_file()), None)


_Text = Annotated[str, msgspec.Meta(min_length=1)]
_Texts = Annotated[list[_Text], msgspec.Meta(min_length=1)]


class _Card(msgspec.Struct):
    """Fields of a card that the harness or a record uses; there may be others."""

    digest: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    data: _Text
    subjects: _Texts
    identifiers: _Texts
    clearance: dict[str, float] = {}
    data_title: str = ""
    schedule_in_words: str = ""
    extra_data: bool = False


def read_card(folder: Path) -> dict[str, Any]:
    """Card of a model.

    What the harness relies on is checked: the digest of the weights, the name of the training data, and the subjects
    and shapes that were seen, without which nobody could tell what the model may be tested on. All further fields
    belong to the learner, which checks them itself (:meth:`Learner.load`, and ``check_card`` where it has one).

    Raises
    ------
    ConfigurationError
        If it is missing, is not JSON, or lacks what every card says.
    """
    path, hint = folder / CARD, "train the model again"
    try:
        card: dict[str, Any] = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        msgspec.convert(card, _Card)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {error.strerror}", hint) from error
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path} is no card of a model: {error}", hint) from error
    return card


def card_digest(card: Mapping[str, Any]) -> str:
    """Return what names a model: the digest of its card, which holds that of the weights; 64 hexadecimal digits.

    A network with the same weights that is told to see another resolution, or to have seen other subjects, is another
    model.
    """
    text = json.dumps(card, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def checked_weights(folder: Path) -> bytes:
    """Bytes of the weights of a model, after comparing them with the digest on its card.

    Raises
    ------
    ConfigurationError
        If the file is missing or is not the one that the card describes.
    """
    expected = read_card(folder)["digest"]
    path = folder / WEIGHTS
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {error.strerror}", "train the model again") from error
    actual = hashlib.sha256(content).hexdigest()
    if actual != expected:
        raise ConfigurationError(
            f"{path} has digest {actual[:12]}..., its card says {expected[:12]}...",
            "fetch the file again or train the model again",
        )
    return content

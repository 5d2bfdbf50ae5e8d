"""Interface for authors of learners, which train a model on pairs of depth images.

A *learner* is a method (see :mod:`benchmark.api.contracts`) that also has ``train`` and ``load``. The harness chooses
the training data by the protocol of a table, without its test subjects, and passes the learner the model for each
shape.
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
"""Name of the weights file in the folder of a model."""

CARD = "card.json"
"""Name of the file with training data and schedule of a model; written last, so that it marks a finished model."""

Split = Literal["table", "strict", "sampled"]
"""Training data of a learner: the training subjects of the table, folds over subjects and poses, or sampled bodies."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingPair:
    """Depth image of a subject in some pose, and that of the same subject in the canonical pose.

    Parameters
    ----------
    identifier
        Name of the shape in the input image.
    subject
        Retrieval class.
    target_identifier
        Name of the shape in the target image.
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
    """Generator of pairs, always in the same order."""

    def __call__(self, start: int = 0) -> Iterator[TrainingPair]:
        """Yield the pairs from an index on, without the cost of the earlier ones."""
        ...


@dataclass(frozen=True, kw_only=True)
class TrainingData:
    """Training pairs of one protocol.

    Parameters
    ----------
    name
        Name of the protocol and folder of its models, e.g. ``"humans-fold-0"``.
    title
        Description of the protocol; identifies stand-ins.
    digest
        Digest of everything that determines the pairs.
    subjects
        Subjects of the pairs.
    identifiers
        All shapes whose images are inputs or targets.
    n_pairs
        Number of pairs.
    clearance
        For each generated set of people, the minimum distance in phenotype space between the bodies and other subjects
        of the set; empty if no body has a phenotype.
    pairs
        Yields the pairs.
    unseen
        Yields pairs of test subjects, for curves and pictures, never for model selection. If subjects are held back for
        validation, yields their pairs instead.
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
    """Method that computes forms with a trained model.

    ``split`` determines the training data, and ``shipped_models`` is the folder of the models that come with the
    method. An optional method ``check_card(card, folder)`` raises ``ConfigurationError`` if the card belongs to another
    learner; it is called before any shape is processed and must not load the weights.
    """

    info: ClassVar[MethodInfo]
    split: ClassVar[Split]
    shipped_models: ClassVar[Path]

    @property
    def model_name(self) -> str:
        """Name of the model's folder in that of its training data; identifies configuration and training seed."""
        ...

    def train(self, data: TrainingData, folder: Path, options: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Train a model into ``folder``, resuming from a checkpoint if there is one; keep a finished model.

        Parameters
        ----------
        data
            Training data.
        folder
            Folder for checkpoint, weights, card and pictures.
        options
            Changes to the method's schedule by name, as given on the command line.
        say
            Called with each line of progress messages.
        """
        ...

    def load(self, folder: Path) -> Self:
        """Return the method with the model in ``folder``; raise ``ConfigurationError`` if it does not fit."""
        ...

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the canonical form, or raise ``UnsupportedShape`` with the reason."""
        ...


@runtime_checkable
class ChecksOptions(Protocol):
    """Learner that checks options before the training data is generated, which may take long."""

    def check_options(self, options: Mapping[str, Any]) -> None:
        """Raise ``ConfigurationError`` if an option is invalid, or needs something that this machine lacks."""
        ...


@runtime_checkable
class MeasuresFit(Protocol):
    """Learner that measures how well its form fits a depth image; the command ``canonicalise`` shows the result."""

    def measure_fit(self, shape: Shape) -> Mapping[str, float | str]:
        """Return notes on the fit; a note named ``"doubt"`` is a warning."""
        ...


def find_model(folders: Iterable[Path], data_name: str, model_name: str) -> Path | None:
    """Return the first folder with a finished model; None if there is none.

    Parameters
    ----------
    folders
        Folders to search, in order: models trained here before shipped ones.
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
    """Fields of a card that the harness or records use; there may be others."""

    digest: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    data: _Text
    subjects: _Texts
    identifiers: _Texts
    clearance: dict[str, float] = {}
    data_title: str = ""
    schedule_in_words: str = ""
    extra_data: bool = False


def read_card(folder: Path) -> dict[str, Any]:
    """Return the card of a model.

    The fields that the harness needs are checked: the digest of the weights, the name of the training data, and its
    subjects and shapes, to detect tests on training data. The learner checks all other fields (:meth:`Learner.load`,
    and ``check_card`` if it has one).

    Raises
    ------
    ConfigurationError
        If it is missing, is not JSON, or lacks a required field.
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
    """Return the digest of the card of a model, 64 hexadecimal digits, which identifies the model.

    The card includes the digest of the weights. The same weights with another resolution or other training subjects on
    the card are another model.
    """
    text = json.dumps(card, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def checked_weights(folder: Path) -> bytes:
    """Return the weights of a model as bytes, after comparing them with the digest on its card.

    Raises
    ------
    ConfigurationError
        If the file is missing, or its digest is not that on the card.
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

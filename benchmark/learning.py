"""What a method that learns adds to the contract: training pairs come in, a folder with a model goes out.

A *learner* is a method (see :mod:`benchmark.contracts`) that also has ``train`` and ``load``. The harness chooses the
training data by the protocol of a table, so that no learner ever sees a shape it is tested on, and hands the learner
the model that fits each shape.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import CanonicalForm, MethodInfo, Shape
from benchmark.errors import ConfigurationError

__all__ = [
    "CARD",
    "WEIGHTS",
    "ChecksOptions",
    "Learner",
    "MakesPairs",
    "Split",
    "TrainingData",
    "TrainingPair",
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
    """What makes pairs anew, one at a time and always in the same order."""

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


@runtime_checkable
class Learner(Protocol):
    """A method whose forms come from a trained model.

    ``split`` says which data trains it, ``shipped_models`` is the folder of the models that come with the method.
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


def read_card(folder: Path) -> dict[str, Any]:
    """Card of a model.

    Raises
    ------
    ConfigurationError
        If it is missing, is not JSON, or names no digest.
    """
    path = folder / CARD
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path} cannot be read: {error}", "train the model again") from error
    if not isinstance(card, dict) or not isinstance(card.get("digest"), str):
        raise ConfigurationError(f"{path} names no digest of the weights", "train the model again")
    return card


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
    found = hashlib.sha256(content).hexdigest()
    if found != expected:
        raise ConfigurationError(
            f"{path} has digest {found[:12]}..., its card says {expected[:12]}...",
            "fetch the file again or train the model again",
        )
    return content

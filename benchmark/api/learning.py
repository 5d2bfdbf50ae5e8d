"""Interface for authors of learners, which train a model on pairs of depth images.

A *learner* is a method (see :mod:`benchmark.api.contracts`) that also has ``train`` and ``load``.
The harness chooses the training data by the protocol of a table, without its test subjects, and
passes the learner the model for each shape.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    Self,
    TypeVar,
    overload,
    runtime_checkable,
)

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, MethodInfo, Shape
from benchmark.errors import ConfigurationError
from benchmark.files import named_errors, read_file

__all__ = [
    "CARD",
    "WEIGHTS",
    "Bodies",
    "Card",
    "HasRecipe",
    "Learner",
    "MeasuresFit",
    "Split",
    "TrainingData",
    "TrainingPair",
    "checked_weights",
    "digest_of",
    "read_card",
]

WEIGHTS = "weights.safetensors"
"""Name of the weights file in the folder of a model."""

CARD = "card.json"
"""Name of the file with training data and schedule of a model.

It is written last, so that it marks a finished model.
"""

FROZEN_AT = "4868b8b9"
"""Last commit of the suite that trains its frozen networks.

It also generates the bodies that they were shown.
"""

Split = Literal["table", "strict", "sampled"]
"""Training data of a learner.

``"table"``: the subjects that a table sets apart for training. ``"strict"``: these subjects, in
poses that are not tested. ``"sampled"``: generated bodies, the same for all tables.
"""


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


def digest_of(subjects: Iterable[str]) -> str:
    """Return the digest of the names of subjects in any order, 64 hexadecimal digits."""
    return hashlib.sha256("\0".join(sorted(subjects)).encode()).hexdigest()


PairSource = Callable[[], Iterator[TrainingPair]]
"""Yields pairs, always in the same order."""


@dataclass(frozen=True, kw_only=True)
class Bodies:
    """Bodies whose pairs are too many for memory.

    A learner may keep them on disk at its resolution.

    Parameters
    ----------
    names
        Name of each body.
    n_images
        Number of images of each; the first is the target of all.
    images
        Returns the images of a body by its place in ``names``, each as in :class:`TrainingPair`.
    recipe
        Digest of what makes the images.
    """

    names: tuple[str, ...]
    n_images: int
    images: Callable[[int], Iterable[NDArray[np.float32]]]
    recipe: str

    def identifiers(self) -> tuple[str, ...]:
        """Return the name of each image."""
        numbers = itertools.product(self.names, range(self.n_images))
        return tuple(f"{name}_{number}" for name, number in numbers)

    def pairs(self) -> Iterator[TrainingPair]:
        """Yield the training pairs, body by body.

        A pair is an image of a body with the first image of that body as its target.
        """
        for number, name in enumerate(self.names):
            images = list(self.images(number))
            for place, image in enumerate(images):
                yield TrainingPair(
                    identifier=f"{name}_{place}",
                    subject=name,
                    target_identifier=f"{name}_0",
                    image=image,
                    target=images[0],
                )


@dataclass(frozen=True, kw_only=True)
class TrainingData:
    """Training pairs of one protocol.

    Parameters
    ----------
    name
        Name of the protocol and folder of its models, e.g. ``"people-fold-0"``.
    title
        Description of the protocol; identifies stand-ins.
    subjects
        Subjects of the pairs.
    identifiers
        All shapes whose images are inputs or targets.
    tested
        Digest of the test subjects, which are left out of the pairs; see :func:`digest_of`.
    pairs
        Yields the pairs.
    n_pairs
        Largest number of pairs; those that cannot be rendered are left out.
    validation
        Yields pairs of other subjects, for curves; no model is selected by them.
    n_validation
        Largest number of pairs for validation.
    clearance
        For each generated set of people, the minimum distance in phenotype space between the bodies
        and other subjects of the set; empty if no body has a phenotype.
    commit
        Commit of the suite that made the pairs; "" if unknown.
    bodies
        What the pairs are made from, if they are too many for memory; otherwise None.
    extra_data
        Whether there are more pairs than the paper's.
    """

    name: str
    title: str
    subjects: tuple[str, ...]
    identifiers: tuple[str, ...]
    tested: str
    pairs: PairSource
    n_pairs: int
    validation: PairSource
    n_validation: int
    clearance: Mapping[str, float] = field(default_factory=dict)
    commit: str = ""
    bodies: Bodies | None = None
    extra_data: bool = False


@runtime_checkable
class Learner(Protocol):
    """Method that computes forms with a trained model.

    ``split`` determines the training data, and ``shipped_models`` is the folder of the models that
    come with the method.
    """

    info: ClassVar[MethodInfo]
    split: ClassVar[Split]
    shipped_models: ClassVar[Path]

    @property
    def model_name(self) -> str:
        """Name of the model's folder in that of its training data.

        It identifies configuration and training seed.
        """
        ...

    def train(
        self,
        data: TrainingData,
        folder: Path,
        options: Mapping[str, Any],
        say: Callable[[str], None],
    ) -> None:
        """Train a model into ``folder``, from a checkpoint if there is one.

        A finished model is kept.

        Parameters
        ----------
        data
            Training data.
        folder
            Folder for checkpoint, weights and card.
        options
            Changes to the method's schedule by name, as given on the command line.
        say
            Called with each line of progress messages.
        """
        ...

    def load(self, folder: Path) -> Self:
        """Return the method with the model in a folder.

        Raise ``ConfigurationError`` if it does not fit.
        """
        ...

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the canonical form, or raise ``UnsupportedShape`` with the reason."""
        ...


@runtime_checkable
class HasRecipe(Protocol):
    """Learner that says how the models of its rows in tables are trained.

    ``run --train`` follows it.
    """

    def seeds(self, training: str) -> Sequence[int]:
        """Return the seeds of the models of tables, for training data of this name."""
        ...

    def recipe(self, training: str) -> Mapping[str, Any]:
        """Return the options of their training."""
        ...

    def training_seconds(self, training: str, n_pairs: int) -> float:
        """Return about how many seconds one core needs for one training on so many pairs.

        Raises
        ------
        ConfigurationError
            If the learner comes trained, and cannot be trained by this code. Then ``run --train``
            leaves it out.
        """
        ...


@runtime_checkable
class MeasuresFit(Protocol):
    """Deprecated: a learner that measures how well its form fits a depth image.

    Write notes of the form instead.
    """

    def measure_fit(self, shape: Shape) -> Mapping[str, float | str]:
        """Return notes on the fit; a note named ``"doubt"`` is a warning."""
        ...


_Text = Annotated[str, msgspec.Meta(min_length=1)]
_Digest = Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]


class Card(msgspec.Struct, frozen=True, kw_only=True):
    """Facts about a model that the suite needs; a learner adds its own in a subclass.

    Attributes
    ----------
    digest
        SHA-256 of the weights.
    data
        Name of the training data.
    subjects, identifiers
        Subjects and shapes in the training data, to detect tests on them.
    tested
        Digest of the test subjects, which were left out of the training.
    clearance
        As in :class:`TrainingData`.
    data_title, schedule_in_words
        Training data and schedule in words.
    extra_data
        Whether the model was trained on more data than the paper's.
    """

    digest: _Digest
    data: _Text
    subjects: Annotated[frozenset[_Text], msgspec.Meta(min_length=1)]
    identifiers: Annotated[frozenset[_Text], msgspec.Meta(min_length=1)]
    tested: str = ""
    clearance: dict[str, float] = {}
    data_title: str = ""
    schedule_in_words: str = ""
    extra_data: bool = False


C = TypeVar("C", bound=Card)


@overload
def read_card(folder: Path) -> Card: ...
@overload
def read_card(folder: Path, kind: type[C]) -> C: ...
def read_card(folder: Path, kind: type[Any] = Card) -> Any:
    """Return the card of a model, which is read once while its file stays the same.

    Raises
    ------
    ConfigurationError
        If it is missing, is not JSON, or lacks a field or has one of another type; the message
        names the field.
    """
    path = folder / CARD
    with named_errors(path, "card of a model", ConfigurationError, "train the model again"):
        status = path.stat()
        return _decoded(path, status.st_mtime_ns, status.st_size, kind)  # type: ignore[arg-type]


@lru_cache(maxsize=256)
def _decoded(path: Path, _mtime: int, _size: int, kind: Any) -> Any:
    """Return the card in a file; time and size tell whether it is the file that was read before."""
    return msgspec.json.decode(read_file(path), type=kind)


def checked_weights(folder: Path) -> bytes:
    """Return the weights of a model as bytes, after comparing them with the digest on its card.

    Raises
    ------
    ConfigurationError
        If the file is missing, or its digest is not that on the card.
    """
    expected = read_card(folder).digest
    path = folder / WEIGHTS
    with named_errors(path, "file of weights", ConfigurationError, "train the model again"):
        content = read_file(path)
    actual = hashlib.sha256(content).hexdigest()
    if actual != expected:
        problem = f"{path} has digest {actual[:12]}..., its card says {expected[:12]}..."
        raise ConfigurationError(problem, "fetch the file again or train the model again")
    return content

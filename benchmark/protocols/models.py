"""Models of the shapes of a gallery, and which of these shapes they were trained on."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.learning import (
    CARD,
    FROZEN_AT,
    Card,
    HasRecipe,
    Learner,
    digest_of,
    read_card,
)
from benchmark.api.parameters import option_words
from benchmark.code_digest import FIRST_PARTY
from benchmark.datasets.catalogue import catalogued, is_known, is_present, open_dataset
from benchmark.datasets.people import CLEARANCE, TESTED
from benchmark.errors import ConfigurationError
from benchmark.files import file_digest
from benchmark.protocols.published_models import published_models
from benchmark.protocols.trainings import (
    TRAININGS,
    Training,
    find_training,
    is_own_training,
    set_of_subjects,
    trainings_by_shape,
)
from benchmark.registry import Component
from benchmark.registry.names import base_name

#: Environment variable of a folder of models with the layout of the repository, for installations
#: without all models.
MODELS_VARIABLE = "CANONICAL_FORMS_MODELS"

#: Sets whose trainings contain people only.
_PEOPLE = ("people", "shrec14-synthetic")


class MissingModel(ConfigurationError):
    """A learner has not been trained for some shapes."""


class UnusableModel(MissingModel):
    """The card of a model is damaged, or says that it was trained for something else."""


class TooNear(ConfigurationError):
    """A model was trained on bodies similar to subjects of a data set."""


@dataclass(frozen=True, eq=False)
class Model:
    """A finished model.

    Parameters
    ----------
    training
        Name of its training data.
    folder
        Folder of weights and card.
    card
        Training data and schedule.
    """

    training: str
    folder: Path
    card: Card

    @cached_property
    def digest(self) -> str:
        """First digits of the digest of the card: it identifies the model."""
        return self.card_digest[:16]

    @cached_property
    def card_digest(self) -> str:
        """Digest of the card, which names that of the weights."""
        return file_digest(self.folder / CARD)

    def has_seen(self, entry: Entry, dataset: str) -> bool:
        """Return whether a shape, or another one of its subject, was in the training data.

        Names are compared if both data sets show the same subjects, or if one of them is a folder,
        which may contain anything. Names in two different known data sets are unrelated.
        """
        shown = set_of_subjects(dataset)
        trained_on = set_of_subjects(find_training(self.training).dataset)
        if shown and trained_on and shown != trained_on:
            return False
        return entry.identifier in self.card.identifiers or entry.subject in self.card.subjects

    def check(self, dataset: str, data_root: Path | None) -> None:
        """Check that a model may be tested on a data set.

        The card states the smallest distance between the training bodies and the subjects of
        generated data sets. A data set that it does not name passes, unless the bodies were
        sampled.

        Raises
        ------
        TooNear
            If the training bodies are, or may be, too similar to subjects of the data set.
        UnusableModel
            If the model was trained for other subjects than those of its training.
        """
        training = find_training(self.training)
        self._check_clearance(dataset, training)
        self._check_tested(training, data_root)

    def _check_clearance(self, dataset: str, training: Training) -> None:
        """Check that a model was trained on no body that resembles a subject of its test.

        Bodies resemble each other if their parameters differ by less than ``CLEARANCE``. The card
        of a model says how near its training bodies come to the subjects of data sets.

        Parameters
        ----------
        dataset
            Name of the data set on which the model is tested.
        training
            The training of the model.

        Raises
        ------
        TooNear
            If it was trained on such a body, or may have been.
        """
        subjects = set_of_subjects(dataset)
        if not subjects.startswith((*TESTED, "animals")):
            return
        # If the card says nothing of the data set, only a training on random bodies may be near.
        clearance = 0.0 if training.is_sampled else CLEARANCE
        verb = "may have"
        for name in (catalogued(dataset) or "", subjects):
            if name in self.card.clearance:
                clearance = self.card.clearance[name]
                verb = "has"
                break
        if clearance < CLEARANCE:
            problem = (
                f"training '{self.training}' {verb} bodies within {CLEARANCE} of the subjects of "
                f"{subjects}"
            )
            raise TooNear(problem, "take a model of another training")

    def _check_tested(self, training: Training, data_root: Path | None) -> None:
        """Raise :class:`UnusableModel` if the model is for other subjects than its training."""
        is_here = is_known(training.dataset) and is_present(training.dataset, data_root)
        if not self.card.tested or not is_here:
            return
        tested = training.tested.of(open_dataset(training.dataset, data_root))
        self.check_held_out(digest_of({entry.subject for entry in tested}))

    def check_held_out(self, tested: str) -> None:
        """Raise :class:`UnusableModel` if the model was trained for other test subjects.

        Parameters
        ----------
        tested
            Digest of the test subjects. A card that does not name its own passes.
        """
        if self.card.tested and self.card.tested != tested:
            problem = f"the model in {self.folder} was trained for other test subjects"
            raise UnusableModel(problem, "train it again")

    def summary(self) -> dict[str, Any]:
        """Facts about the model for a record."""
        return {
            "training": self.training,
            "data": self.card.data_title or self.training,
            "digest": self.digest,
            "schedule": self.card.schedule_in_words,
            "extra_data": self.card.extra_data,
        }


def find_models(
    spec: Component,
    dataset: ShapeSet,
    entries: Iterable[Entry],
    data_root: Path | None,
    trained_here: Path | None,
) -> dict[str, Model]:
    """Find the trained model of a method for each of some shapes.

    A method may have been trained once for each fold. A shape then gets the model that was trained
    without its subject.

    Parameters
    ----------
    spec
        The method.
    dataset
        The data set of the shapes.
    entries
        The shapes that need a model.
    data_root
        The folder of the official data sets.
    trained_here
        Folder of the models that were trained here. They are preferred to those of the suite.

    Returns
    -------
    dict
        Models by name of the shape; empty for a method that does not learn.

    Raises
    ------
    MissingModel
        If a model is missing, with the command that trains it as hint, or cannot be used.
    NoFolds
        If the learner has a model for each fold, but the data set has no folds.
    TooNear
        If a model was trained on bodies similar to subjects of the data set.
    ConfigurationError
        If the learner names a training that does not exist.
    """
    if not spec.learns:
        return {}
    learner: Any = spec.create()
    if not isinstance(learner, Learner):
        return {}

    training_of_shape = trainings_by_shape(learner, dataset, entries, data_root)
    names = {training.name for training in training_of_shape.values()}
    folders = {name: _finished(learner, name, trained_here) for name in sorted(names)}
    missing = [name for name, folder in folders.items() if folder is None]
    if missing:
        raise _missing(spec, learner, missing)

    models = {name: model_in(folder, name) for name, folder in folders.items() if folder}
    for model in models.values():
        model.check(dataset.name, data_root)
    return {shape: models[training.name] for shape, training in training_of_shape.items()}


def with_model(spec: Component) -> Any:
    """Return a method for use outside tables.

    A learner is returned with its default model, if it has one.

    Raises
    ------
    MissingModel
        If the model is missing.
    ConfigurationError
        If it cannot be used.
    """
    method: Any = spec.create()
    own_folder = getattr(method, "model_folder", None)
    if not isinstance(method, Learner) or not isinstance(own_folder, Path):
        return method
    training = own_folder.parent.name
    folder = _finished(method, training, None)
    if folder is None:
        raise _missing(spec, method, [training])
    return method.load(folder)


def people_training(folder: object) -> str:
    """Return the training of the model in a folder, or of a method's, if it shows people alone.

    It is "" otherwise.
    """
    folder = getattr(folder, "model_folder", folder)
    if not isinstance(folder, Path):
        return ""
    training = TRAININGS.get(folder.parent.name)
    if training is None or base_name(training.dataset) not in _PEOPLE:
        return ""
    return training.name


def model_places(learner: Learner) -> list[Path]:
    """Return the folders of models that were not trained here, by precedence.

    They are those of the environment variable, and the shipped ones.
    """
    places = [learner.shipped_models]
    named = os.environ.get(MODELS_VARIABLE)
    if named:
        places.insert(0, Path(named))
    return places


def folder_of_training(learner: Learner, training: str, trained_here: Path) -> Path:
    """Return the folder of a model that is trained here.

    Networks of the suite share models. The models of any other learner are its own, although
    another one may call its models alike.

    Parameters
    ----------
    learner
        The learner.
    training
        Name of the training data.
    trained_here
        Folder of the models that are trained here.
    """
    name = learner.model_name
    if type(learner).__module__.partition(".")[0] not in FIRST_PARTY:
        name = f"{learner.info.name}-{name}"
    return trained_here / training / name


def has_model(learner: Learner, training: str, trained_here: Path | None) -> bool:
    """Return whether a learner has a finished model of a training, usable or not."""
    return _finished(learner, training, trained_here) is not None


def can_be_trained(learner: Learner, training: str) -> bool:
    """Return whether this code can train a model of a learner on the data of a training.

    The code that made the bodies of a training, or that trained a network, may be gone.
    """
    if training in TRAININGS and TRAININGS[training].is_frozen:
        return False
    if isinstance(learner, HasRecipe):
        try:
            learner.training_seconds(training, 1)
        except ConfigurationError:
            return False
    return True


def _finished(learner: Learner, training: str, trained_here: Path | None) -> Path | None:
    """Return the folder of the finished model of a training, one that was trained here first.

    It is None if there is none.
    """
    folders = [place / training / learner.model_name for place in model_places(learner)]
    if trained_here is not None:
        folders.insert(0, folder_of_training(learner, training, trained_here))
    for folder in folders:
        if (folder / CARD).is_file():
            return folder
    return None


def _missing(spec: Component, learner: Learner, names: Sequence[str]) -> MissingModel:
    """Return the error for models that are missing, with the commands that train or fetch them.

    Parameters
    ----------
    spec, learner
        The method, as a component and as the object that learns.
    names
        Names of the trainings.
    """
    ways = []
    are_trainable = all(can_be_trained(learner, name) for name in names)
    if are_trainable:
        words = ["python", "-m", "benchmark", "train", spec.name]
        if is_own_training(names[0]):
            words += ["--data", "FOLDER", "--hold-out", "SUBJECT"]
        elif len(names) == 1:
            words += ["--table", names[0]]
        if isinstance(learner, HasRecipe):  # the models of a table follow one recipe
            words += option_words(learner.recipe(names[0]))
        if spec.plugin:
            words += ["--plugin", str(spec.plugin)]
        ways.append(f"run `{shlex.join(words)}`")
    if all(f"{name}/{learner.model_name}" in published_models() for name in names):
        fetch = shlex.join(["python", "-m", "benchmark", "models", "fetch", *names])
        ways.append(f"run `{fetch} --from CHECKOUT/learned/models`")
    if not are_trainable:
        ways.append(f"train at commit {FROZEN_AT}")
    hint = ", or ".join(ways)
    models = "model" if len(names) == 1 else "models"
    return MissingModel(f"needs the {models} {', '.join(names)}", hint)


def model_in(folder: Path, training: str) -> Model:
    """Return the model in a folder.

    Raise :class:`UnusableModel` if its card is damaged, or not that of this training.
    """
    try:
        card = read_card(folder)
    except ConfigurationError as error:
        raise UnusableModel(error.problem, error.hint, error.file) from error
    if card.data != training:
        problem = f"the model in {folder} was trained on '{card.data}'"
        raise UnusableModel(problem, "move it to the folder of its training data")
    return Model(training, folder, card)

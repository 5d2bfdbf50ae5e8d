"""Assignment of trained models to the shapes of a gallery, and whether a model has seen a shape before."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.api.learning import CARD, WEIGHTS, Learner, find_model, read_card
from benchmark.datasets.base import Entry
from benchmark.datasets.files import file_digest
from benchmark.datasets.human_subjects import CLEARANCE, TESTED
from benchmark.datasets.jittered import clean_dataset
from benchmark.errors import ConfigurationError
from benchmark.plugins.registry import MethodSpec
from benchmark.protocols.trainings import TRAININGS, set_of_subjects, trainings_by_shape
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.protocols.galleries import Gallery

#: Environment variable of a folder of models laid out as those of the repository, for installations without them all.
MODELS_VARIABLE = "CANONICAL_FORMS_MODELS"

#: File beside the models of the repository; a wheel, which has no room for all of them, leaves it out.
_ALL_HERE = "README.md"

_INSTEAD = "take a model of another training"


class MissingModel(ConfigurationError):
    """A learner has not been trained for a gallery, or its model cannot be used."""


class TooNear(ConfigurationError):
    """A model was trained on bodies near to the subjects of a set."""


@dataclass(frozen=True, eq=False)
class Model:
    """A finished model.

    Parameters
    ----------
    training
        Name of its training data.
    folder
        Where weights and card are.
    card
        What it was trained on and how.
    """

    training: str
    folder: Path
    card: Mapping[str, Any]

    @cached_property
    def digest(self) -> str:
        """Return what recipes name it by: the digest of its weights, wherever they lie."""
        weights = self.folder / WEIGHTS
        return (file_digest(weights) if weights.is_file() else str(self.card["digest"]))[:16]

    def has_seen(self, entry: Entry, dataset: str) -> bool:
        """Return whether training showed a shape, or another one of its subject.

        Names say so within sets of the same subjects, and in a folder, which may hold anything; those of two known
        sets mean different things.
        """
        if set_of_subjects(dataset) not in (None, TRAININGS[self.training].dataset):
            return False
        return entry.identifier in self.card["identifiers"] or entry.subject in self.card["subjects"]

    def check_clearance(self, dataset: str) -> None:
        """Raise :class:`TooNear` if it must not be tested on a set, for the bodies that it was trained on.

        Its card says how near they come to subjects of each generated set of people that they are none of. A card that
        says nothing of a set tells of no such bodies, unless they were sampled.
        """
        shown, sampled = set_of_subjects(dataset) or "", TRAININGS[self.training].is_sampled
        if sampled and shown.startswith("humans["):
            raise TooNear(f"the bodies of {shown} are drawn as those of training '{self.training}' are", _INSTEAD)
        distance = self.card.get("clearance", {}).get(shown, 0.0 if sampled else CLEARANCE)
        if shown in TESTED and distance < CLEARANCE:
            raise TooNear(
                f"training '{self.training}' did not stay {CLEARANCE} away from the subjects of {shown}", _INSTEAD
            )

    def summary(self) -> dict[str, Any]:
        """Return what a record tells of it."""
        return {
            "training": self.training,
            "data": str(self.card.get("data_title", self.training)),
            "digest": self.digest,
            "schedule": str(self.card.get("schedule_in_words", "")),
            "extra_data": bool(self.card.get("extra_data", False)),
        }


def find_models(
    spec: MethodSpec, gallery: Gallery, trained_here: Path, proven: Collection[str] = ()
) -> dict[str, Model]:
    """Model for each shape of a gallery, by identifier; empty for a method that does not learn.

    Parameters
    ----------
    spec
        The method.
    gallery
        The shapes.
    trained_here
        Folder of the models that were trained here; the shipped ones come after them.
    proven
        Digests of models by which the method has made results: their cards are not checked again, for that imports what
        networks need.

    Raises
    ------
    MissingModel
        If one has not been trained; the message says by which command it is.
    NoFolds
        If the learner has a model for each fold and the set has none.
    TooNear
        If one was trained on bodies near to subjects of the set.
    ConfigurationError
        If the learner names a training that does not exist.
    """
    method = spec.create() if spec.learns else None
    if not isinstance(method, Learner):
        return {}
    of_shape = trainings_by_shape(method, clean_dataset(gallery.dataset), gallery.entries, gallery.data_root)
    names = dict.fromkeys(training.name for training in of_shape.values())
    folders = {name: _finished(method, name, trained_here) for name in names}
    missing = [name for name in names if not folders[name]]
    if missing:
        raise _missing(spec, method, missing)
    try:
        models = {name: _first_usable(spec, name, folders[name], proven) for name in names}
    except ConfigurationError as error:
        raise MissingModel(error.problem, error.hint) from error
    for model in models.values():
        model.check_clearance(gallery.dataset.name)
    return {identifier: models[training.name] for identifier, training in of_shape.items()}


def has_models(spec: MethodSpec, gallery: Gallery, trained_here: Path | None) -> bool:
    """Return whether a learner has a finished model for each shape of a gallery."""
    learner = spec.create()
    if not isinstance(learner, Learner):
        return False
    try:
        of_shape = trainings_by_shape(learner, clean_dataset(gallery.dataset), gallery.entries, gallery.data_root)
    except ConfigurationError:
        return False  # the row of the plain method says why
    return all(_finished(learner, name, trained_here) for name in {training.name for training in of_shape.values()})


def with_model(spec: MethodSpec) -> Any:
    """Return a method; a learner that names a model for where no table chooses one comes with it.

    Raises
    ------
    MissingModel
        If that model is not here.
    ConfigurationError
        If it cannot be used.
    """
    method: Any = spec.create()
    wanted = getattr(method, "model_folder", None)
    if not isinstance(method, Learner) or not isinstance(wanted, Path):
        return method
    folder = find_model(model_places(method), wanted.parent.name, wanted.name)
    if folder is None:
        raise _missing(spec, method, [wanted.parent.name])
    return method if folder == wanted else method.load(folder)


def model_places(learner: Learner, trained_here: Path | None = None) -> list[Path]:
    """Folders of models, those that come first count: trained here, of the variable, shipped with the learner.

    Parameters
    ----------
    learner
        The learner.
    trained_here
        Folder of the models that were trained here; None where they do not count.
    """
    named = os.environ.get(MODELS_VARIABLE, "")
    places = (trained_here, Path(named) if named else None, learner.shipped_models)
    return [place for place in places if place is not None]


def _finished(learner: Learner, training: str, trained_here: Path | None) -> list[Path]:
    """Folders of the finished models of one training, in the order of the places."""
    folders = (place / training / learner.model_name for place in model_places(learner, trained_here))
    return [folder for folder in folders if (folder / CARD).is_file()]


def _missing(spec: MethodSpec, learner: Learner, names: Sequence[str]) -> MissingModel:
    """Error that names the models, the command that trains them, and where else they are if this package lacks them."""
    words = ["python", "-m", "benchmark", "train", spec.name]
    if len(names) == 1:
        words += ["--only", names[0]]
    if spec.module.endswith(".py"):
        words += ["--plugin", spec.module]
    hint, package, shipped = f"run `{shlex.join(words)}`", Path(__file__).parents[2], learner.shipped_models
    if shipped.is_relative_to(package) and not (shipped / _ALL_HERE).is_file():
        place = shipped.relative_to(package)
        hint += f", or name the folder {place} of a checkout in {MODELS_VARIABLE}: installed packages lack this model"
    return MissingModel(f"needs the model{'s' if len(names) > 1 else ''} {', '.join(names)}", hint)


#: Folders of models that were named as unusable.
_PASSED_OVER: set[Path] = set()

#: Models by method, training and the state of their card: many jobs share one, and its card can name 10 000 subjects.
_READ: dict[tuple[str, str, str, Path, int, int], Model] = {}


def _first_usable(spec: MethodSpec, training: str, folders: Sequence[Path], proven: Collection[str]) -> Model:
    """The first model that can be used; those before it are named on stderr, once.

    Raises
    ------
    ConfigurationError
        What is wrong with the last one, if none can be used.
    """
    *others, last = folders
    for folder in others:
        try:
            return _model(spec, training, folder, proven)
        except ConfigurationError as error:
            if folder not in _PASSED_OVER:
                _PASSED_OVER.add(folder)
                say(f"passed over the model in {folder}: {error}", err=True)
    return _model(spec, training, last, proven)


def _model(spec: MethodSpec, training: str, folder: Path, proven: Collection[str]) -> Model:
    """The model in a folder; raises ``ConfigurationError`` if its card is not that of such a model."""
    status = (folder / CARD).stat()
    place = (spec.name, spec.module, training, folder, status.st_mtime_ns, status.st_size)
    if place not in _READ:
        card = read_card(folder)
        if card["data"] != training:
            raise ConfigurationError(
                f"the model in {folder} was trained on '{card['data']}'", "put it into the folder of its training data"
            )
        model = Model(training, folder, card)
        check = getattr(spec.create(), "check_card", None)
        if check is not None and model.digest not in proven:
            check(card, folder)
        _READ[place] = model
    return _READ[place]

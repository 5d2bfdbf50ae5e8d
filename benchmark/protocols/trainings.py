"""Training protocols of learners as data: the data set, its shapes for training, and its shapes for testing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.learning import Learner
from benchmark.datasets.base import Part
from benchmark.datasets.catalogue import catalogued, is_present, open_dataset
from benchmark.errors import ConfigurationError, check_known


class NoFolds(ConfigurationError):
    """A learner has a model for each fold, but a data set has no folds."""


SAMPLED_PEOPLE = "humans-sampled"
"""Training on random people, in the frame of ``people[draw=0]``."""

#: Trainings on random bodies that are in no data set, and the data set whose frame they are in.
_SAMPLED = {
    SAMPLED_PEOPLE: "people[draw=0]",
    "animals-sampled": "animals",
    "humans-varied": "people[draw=0]",
}

FROZEN_AT = "4868b8b9"
"""Last commit that generates the bodies of the frozen trainings, and trains their networks."""

_FROZEN = ("animals-sampled", "humans-varied")

_WHOLE = Part()


@dataclass(frozen=True)
class Training:
    """Training protocol.

    Parameters
    ----------
    name
        Name on the command line and folder of its models.
    dataset
        Name of the data set.
    trained
        Shapes that become pairs.
    tested
        Shapes for which the models are trained; the training data includes none of their subjects.
    """

    name: str
    dataset: str
    trained: Part = _WHOLE
    tested: Part = _WHOLE

    @property
    def is_sampled(self) -> bool:
        """Whether its bodies are random ones of no data set."""
        return self.name in _SAMPLED

    @property
    def is_frozen(self) -> bool:
        """Whether the code that generated its bodies is gone; its models come with the suite."""
        return self.name in _FROZEN

    @property
    def words(self) -> str:
        """Shapes that it trains on, in words, without the data set."""
        poses = f"poses {_counted(self.trained.poses)}" if self.trained.poses else "all poses"
        return f"subjects {_counted(self.trained.subjects)} in {poses}"


def _counted(names: tuple[int | str, ...]) -> str:
    """Return names, and indices counted from 1."""
    return ", ".join(str(name + 1) if isinstance(name, int) else name for name in names)


#: Indices of the subjects of the synthetic humans in each fold. The paper tests on five of fifteen
#: subjects and does not say which; here each subject is tested once, by a rule that depends only on
#: the order of the data set. The first term assigns subjects to the folds in turn; the second
#: shifts the assignment by one every three subjects. Every fold therefore has men, women and
#: children, whether the data set lists five of each kind in succession, or man, woman and child in
#: turn, where the first term alone would fill each fold with one kind.
SUBJECT_FOLDS = tuple(tuple(p for p in range(15) if (p + p // 3) % 3 == fold) for fold in range(3))

#: Indices of the poses of each subject in each fold of the strict trainings: five consecutive ones.
POSE_FOLDS: tuple[tuple[int, ...], ...] = tuple(
    tuple(range(5 * fold, 5 * fold + 5)) for fold in range(4)
)

#: Classes on which the models of Table III are tested; the paper trains on "other animals".
HELD_OUT = ("cat", "horse")
OTHER_ANIMALS = ("centaur", "dog", "gorilla", "wolf")

#: Data sets that show subjects of another one.
_SAME_SUBJECTS = {"animals-few": "animals", "shrec16-cuts": "tosca", "shrec16-holes": "tosca"}


def set_of_subjects(dataset: str) -> str:
    """Return the data set of the catalogue whose subjects a (changed) data set shows; "" if unknown."""
    name = (catalogued(dataset) or "").partition("[draw=")[0]
    return _SAME_SUBJECTS.get(name, name)


def _of_humans(prefix: str, dataset: str) -> Iterator[Training]:
    for number, tested in enumerate(SUBJECT_FOLDS):
        trained = _others(tested, SUBJECT_FOLDS)
        yield Training(f"{prefix}-fold-{number}", dataset, Part(trained), Part(tested))
        for pose_number, poses in enumerate(POSE_FOLDS):
            seen, unseen = Part(trained, _others(poses, POSE_FOLDS)), Part(tested, poses)
            yield Training(f"{prefix}-strict-{number}-{pose_number}", dataset, seen, unseen)


def _others(left_out: tuple[int, ...], folds: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    return tuple(sorted(place for fold in folds if fold != left_out for place in fold))


TRAININGS: Mapping[str, Training] = {
    training.name: training
    for training in (
        *_of_humans("shrec14-synthetic", "shrec14-synthetic"),
        *_of_humans("people", "people[draw=0]"),
        *(
            Training(f"{name}-III", name, Part(OTHER_ANIMALS), Part(HELD_OUT))
            for name in ("tosca", "animals")
        ),
        *(Training(name, dataset) for name, dataset in _SAMPLED.items()),
    )
}
"""All protocols by name."""


_OWN = "own-"
"""Beginning of the names of trainings on the user's own data."""


def own_training(folder: Path, hold_out: Sequence[str]) -> Training:
    """Return the training on a folder of shapes, without some of its subjects.

    Raises
    ------
    ConfigurationError
        If no subject is held out, an unknown one is, or none remains.
    DatasetError
        If the folder has no shapes.
    """
    subjects = list(
        dict.fromkeys(entry.subject for entry in open_dataset(str(folder), None).shapes)
    )
    check_known(f"subject of {folder}", hold_out, subjects)
    rest = tuple(name for name in subjects if name not in hold_out)
    if not (rest and hold_out):
        problem = f"{folder} has no subject left to {'train on' if hold_out else 'test'}"
        raise ConfigurationError(problem, "hold out some")
    name = _OWN + re.sub("[^A-Za-z0-9-]+", "-", folder.resolve().name).strip("-")
    return Training(name, str(folder), Part(rest), Part(tuple(hold_out)))


def find_training(name: str) -> Training:
    """Return a training by name; raise ``ConfigurationError`` for an unknown one."""
    if name.startswith(_OWN):
        return Training(name, "")
    check_known("training", [name], TRAININGS)
    return TRAININGS[name]


def trainings_by_shape(
    learner: Learner, dataset: ShapeSet, entries: Iterable[Entry], data_root: Path | None
) -> dict[str, Training]:
    """Return the training whose model is used for each shape, by identifier; of several, the one without its subject.

    Parameters
    ----------
    learner
        The method; its parameter ``training``, if set, names the only training.
    dataset, entries
        The shapes.
    data_root
        The folder of the official data sets.

    Raises
    ------
    NoFolds
        If the learner has a model for each fold and the data set has no folds.
    ConfigurationError
        If the training is unknown.
    """
    first, *others = _trainings(learner, dataset.name, data_root)
    of_shape: dict[str, Training] = {}
    if others:
        # Indices of poses refer to the training data set, of which another data set may show only
        # some.
        trained_on = (
            dataset if dataset.name == first.dataset else open_dataset(first.dataset, data_root)
        )
        of_shape = {
            entry.identifier: each
            for each in (first, *others)
            for entry in each.tested.of(trained_on)
        }
    # Subjects of another draw are in no fold; whether a model may be tested on them, its card says.
    return {entry.identifier: of_shape.get(entry.identifier, first) for entry in entries}


def _trainings(learner: Learner, dataset: str, data_root: Path | None) -> list[Training]:
    """Return the trainings whose models a learner uses for a data set: one for each fold, or one for all shapes.

    Data sets of people without folds are unrelated to all folds of the synthetic humans, so the
    model of the first fold is used: that of the official synthetic humans for the official scans of
    people, if available, else that of the generated ones.
    """
    if named := getattr(learner, "training", ""):
        return [find_training(named)]
    if learner.split == "sampled":
        return [TRAININGS[getattr(learner, "default_training", "humans-sampled")]]
    shown, kind = set_of_subjects(dataset), "strict" if learner.split == "strict" else "fold"
    if folds := [
        training for name, training in TRAININGS.items() if name.startswith(f"{shown}-{kind}-")
    ]:
        return folds
    if kind == "strict":
        raise NoFolds(
            f"the set '{dataset}' has no folds of subjects and poses", "use the synthetic humans"
        )
    if shown in ("tosca", "animals"):
        return [TRAININGS[f"{shown}-III"]]
    is_official = shown == "shrec14-real" and is_present("shrec14-synthetic", data_root)
    return [TRAININGS[f"{'shrec14-synthetic' if is_official else 'people'}-fold-0"]]

"""Training protocols of learners as data: the data set, its shapes for training, and its shapes for testing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmark.api.learning import Learner
from benchmark.datasets.base import Dataset, Entry, Part
from benchmark.datasets.catalogue import catalogued, is_present, open_dataset
from benchmark.errors import ConfigurationError, did_you_mean


class NoFolds(ConfigurationError):
    """A learner has a model for each fold, but a data set has no folds."""


_WHOLE = Part()


@dataclass(frozen=True)
class Training:
    """Training protocol.

    Parameters
    ----------
    name
        Name on the command line and folder of its models.
    words
        Shapes that it trains on, in words, without the data set.
    dataset
        Name of the data set.
    trained
        Shapes that become pairs; empty if bodies are sampled.
    tested
        Shapes for which the models are trained; the training data includes none of their subjects.
    """

    name: str
    words: str
    dataset: str
    trained: Part = _WHOLE
    tested: Part = _WHOLE

    @property
    def is_sampled(self) -> bool:
        """Whether it uses sampled bodies, in the frame of a data set."""
        return self.trained == _WHOLE


def subject_fold(place: int) -> int:
    """Return the fold of a subject of the synthetic humans by its index p in the data set: (p + p // 3) mod 3.

    The paper tests on five of fifteen subjects and does not say which. Here each subject is tested once, by a rule that
    depends only on the order of the data set. The first term assigns subjects to the folds in turn; the second shifts
    the assignment by one every three subjects. Every fold therefore has men, women and children, whether the data set
    lists five of each kind in succession, or man, woman and child in turn, where the first term alone would fill each
    fold with one kind.

    Parameters
    ----------
    place
        Index of the subject in the data set, from 0.
    """
    return (place + place // 3) % 3


#: Indices of the subjects of the synthetic humans in each fold.
SUBJECT_FOLDS: tuple[tuple[int, ...], ...] = tuple(
    tuple(place for place in range(15) if subject_fold(place) == fold) for fold in range(3)
)

#: Indices of the poses of each subject in each fold of the strict trainings: five consecutive ones.
POSE_FOLDS: tuple[tuple[int, ...], ...] = tuple(tuple(range(5 * fold, 5 * fold + 5)) for fold in range(4))

#: Classes on which the models of Table III are tested; the paper trains on "other animals".
HELD_OUT = ("cat", "horse")
OTHER_ANIMALS = ("centaur", "dog", "gorilla", "wolf")
PEOPLE = ("david", "michael", "victoria")

#: Training on animals that a learner with the split "table" uses by default: "III" or "III-people".
TABLE_III = "III"

#: Data sets that show subjects of another one.
_SAME_SUBJECTS = {
    "animals-few": "animals",
    "shrec16-cuts": "tosca",
    "shrec16-holes": "tosca",
    **{f"people[draw={draw}]": "people" for draw in range(3)},
}

#: Data sets with some of the poses of another one, for which the fold of a pose is unknown.
_FEWER_POSES = frozenset({"animals-few"})


def set_of_subjects(dataset: str) -> str | None:
    """Return the data set of the catalogue whose subjects a (changed) data set shows; None if unknown."""
    name = catalogued(dataset)
    return None if name is None else _SAME_SUBJECTS.get(name, name)


#: Name of the training on sampled bodies, and its default numbers of bodies and poses.
SAMPLED = "humans-sampled"
SAMPLED_BODIES, SAMPLED_POSES = 1500, 6

#: Name of the training on sampled animals and people, and the number of poses of each.
ANIMALS_SAMPLED, ANIMAL_POSES = "animals-sampled", 12

#: Trainings whose number of bodies can be chosen.
COUNTED = frozenset({SAMPLED, ANIMALS_SAMPLED})

#: Name of the training on a stream of new bodies in free poses.
VARIED = "humans-varied"


def _of_humans(dataset: str) -> Iterator[Training]:
    for number, subjects in enumerate(SUBJECT_FOLDS):
        trained = _others(subjects, SUBJECT_FOLDS)
        words = f"subjects {_counted(trained)} in all poses"
        yield Training(f"{dataset}-fold-{number}", words, dataset, Part(trained), Part(subjects))
        for pose_number, poses in enumerate(POSE_FOLDS):
            name = f"{dataset}-strict-{number}-{pose_number}"
            words = f"all but subjects {_counted(subjects)} and poses {_counted(poses)}"
            yield Training(name, words, dataset, Part(trained, _others(poses, POSE_FOLDS)), Part(subjects, poses))


def _others(left_out: tuple[int, ...], folds: tuple[tuple[int, ...], ...]) -> tuple[int, ...]:
    return tuple(sorted(place for fold in folds if fold != left_out for place in fold))


def _counted(subjects: tuple[int | str, ...]) -> str:
    """Describe subjects by index, counted from 1."""
    return ", ".join(str(subject + 1) if isinstance(subject, int) else subject for subject in subjects)


def _of_animals(dataset: str) -> Iterator[Training]:
    for suffix, classes in ("III", OTHER_ANIMALS), ("III-people", (*OTHER_ANIMALS, *PEOPLE)):
        words = f"{', '.join(sorted(classes))} in all poses"
        yield Training(f"{dataset}-{suffix}", words, dataset, Part(classes), Part(HELD_OUT))


TRAININGS: Mapping[str, Training] = {
    training.name: training
    for training in (
        *_of_humans("shrec14-synthetic"),
        *_of_humans("humans"),
        *_of_animals("tosca"),
        *_of_animals("animals"),
        Training(SAMPLED, "sampled bodies that are none of the data set's", "humans"),
        Training(ANIMALS_SAMPLED, "sampled animals and people that are in no data set", "animals"),
        Training(VARIED, "fresh bodies in free poses that are none of the data set's", "humans"),
    )
}
"""All protocols by name."""


def find_training(name: str) -> Training:
    """Return a training by name; raise ``ConfigurationError`` for an unknown one."""
    if name not in TRAININGS:
        raise did_you_mean("training", name, TRAININGS)
    return TRAININGS[name]


def with_validation(training: Training, n_subjects: int) -> Training:
    """Return a training without some of its subjects, which replace the test subjects for validation.

    Schedules and parameters are chosen by validation. Test subjects are in neither part. The training subjects are
    divided into as many equal runs as subjects are held back, and the k-th one of run k is taken; subjects after the
    last run stay in training. As with :func:`subject_fold`, the held-back subjects are then not all of one kind,
    whether the data set lists its kinds in succession or in turn.

    Parameters
    ----------
    training
        The protocol.
    n_subjects
        Number of subjects to hold back.

    Raises
    ------
    ConfigurationError
        If no training subject would be left.
    """
    subjects = training.trained.subjects
    if not 0 < n_subjects < len(subjects):
        raise ConfigurationError(
            f"training '{training.name}' cannot hold back {n_subjects} of {len(subjects)} subjects",
            f"choose fewer than {len(subjects)}" if len(subjects) > 1 else "train without validation",
        )
    length = len(subjects) // n_subjects
    held_back = tuple(subjects[run * length + run % length] for run in range(n_subjects))
    rest = tuple(subject for subject in subjects if subject not in held_back)
    return replace(
        training,
        name=f"{training.name}-validation-{n_subjects}",
        words=f"{training.words}, without {_counted(held_back)} for validation",
        trained=replace(training.trained, subjects=rest),
        tested=replace(training.tested, subjects=held_back),
    )


def trainings_on(learner: Learner, dataset: str, data_root: Path | None) -> list[Training]:
    """Return the trainings whose models a learner uses for a data set: one for each fold, or one for all shapes.

    Data sets of people without folds are unrelated to all folds of the synthetic humans, so the model of the first fold
    is used: that of the official synthetic humans for the official scans of people, if available, else that of the
    generated ones.

    Parameters
    ----------
    learner
        The method; its parameter ``training``, if set, names the only training.
    dataset
        Name of the data set.
    data_root
        The folder of the official data sets.

    Raises
    ------
    NoFolds
        If the learner has a model for each fold and the data set has no folds.
    ConfigurationError
        If the training is unknown.
    """
    if only := only_training(learner):
        return [only]
    trained_on, is_strict = set_of_subjects(dataset) or dataset, learner.split == "strict"
    prefix = f"{trained_on}-{'strict' if is_strict else 'fold'}-"
    folds = [training for name, training in TRAININGS.items() if name.startswith(prefix)]
    if folds and not (is_strict and catalogued(dataset) in _FEWER_POSES):
        return folds
    if is_strict:
        raise NoFolds(f"the set '{dataset}' has no folds of subjects and poses", "use the synthetic humans")
    if trained_on in ("tosca", "animals"):
        return [TRAININGS[f"{trained_on}-{TABLE_III}"]]
    is_official = trained_on == "shrec14-real" and is_present("shrec14-synthetic", data_root)
    return [TRAININGS[f"{'shrec14-synthetic' if is_official else 'humans'}-fold-0"]]


def trainings_by_shape(
    learner: Learner, dataset: Dataset, entries: Iterable[Entry], data_root: Path | None
) -> dict[str, Training]:
    """Return the training whose model is used for each shape, by identifier; of several, the one without its subject.

    Parameters
    ----------
    learner, data_root
        See :func:`trainings_on`, also for errors.
    dataset, entries
        The shapes.
    """
    entries = list(entries)
    trainings = trainings_on(learner, dataset.name, data_root)
    if len(trainings) == 1:
        return dict.fromkeys((entry.identifier for entry in entries), trainings[0])
    # Indices of poses refer to the training data set, of which another data set may show only some.
    if dataset.name != trainings[0].dataset:
        dataset = open_dataset(trainings[0].dataset, data_root)
    shapes = tuple((entry.identifier, entry.subject) for entry in dataset.entries)
    place = shapes, *(training.name for training in trainings)
    if place not in _OF_SHAPE:
        _OF_SHAPE[place] = {e.identifier: training for training in trainings for e in training.tested.of(dataset)}
    return {entry.identifier: _OF_SHAPE[place][entry.identifier] for entry in entries}


#: Cache of the training for each shape, by the shapes and the names of the trainings: many rows share it.
_OF_SHAPE: dict[tuple[Any, ...], Mapping[str, Training]] = {}


def only_training(learner: Learner) -> Training | None:
    """Return the only training of a learner; None if it has several."""
    if named := getattr(learner, "training", ""):
        return find_training(named)
    return TRAININGS[SAMPLED] if learner.split == "sampled" else None

"""Training sets of learners, as data: which shapes of which set become pairs, and which never do."""

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
    """A learner has a model for each fold, and a set has no folds."""


_WHOLE = Part()


@dataclass(frozen=True)
class Training:
    """One training protocol.

    Parameters
    ----------
    name
        Name on the command line and folder of its models.
    words
        Which shapes it trains on, without naming the set.
    dataset
        Name of the set.
    trained
        Shapes that become pairs; none where bodies are sampled.
    tested
        Shapes that the models are made for; the training data holds none of their subjects.
    """

    name: str
    words: str
    dataset: str
    trained: Part = _WHOLE
    tested: Part = _WHOLE

    @property
    def is_sampled(self) -> bool:
        """Return whether it shows bodies that are in no set, in the frame of one."""
        return self.trained == _WHOLE


def subject_fold(place: int) -> int:
    """Fold of a subject of the synthetic humans, by its place p in the set: (p + p // 3) mod 3.

    The paper tests on five of fifteen subjects and does not say which. Here each subject is tested once, by a rule that
    looks at nothing but the order of the set. The first term deals the subjects out in turn; the second one shifts the
    deal by one every three subjects. So every fold has men, women and children however a set is sorted: of five
    neighbours, the run of one kind in a set that lists its kinds one after the other, every fold has one at least; and
    in a set that lists man, woman, child in turn, a fold takes another one of the three from each triple to the next,
    where dealing out without the shift would give it one kind alone.

    Parameters
    ----------
    place
        Place of the subject in the set, from 0.
    """
    return (place + place // 3) % 3


#: Places of the subjects of the synthetic humans in each fold.
SUBJECT_FOLDS: tuple[tuple[int, ...], ...] = tuple(
    tuple(place for place in range(15) if subject_fold(place) == fold) for fold in range(3)
)

#: Places of the poses of each subject in each fold of the strict trainings: five neighbours.
POSE_FOLDS: tuple[tuple[int, ...], ...] = tuple(tuple(range(5 * fold, 5 * fold + 5)) for fold in range(4))

#: Classes that the models of Table III are tested on; the paper trains on "other animals".
HELD_OUT = ("cat", "horse")
OTHER_ANIMALS = ("centaur", "dog", "gorilla", "wolf")
PEOPLE = ("david", "michael", "victoria")

#: Which of the two trainings on animals a table-bound learner uses by default: "III" or "III-people".
TABLE_III = "III"

#: Sets that show subjects of another one.
_SAME_SUBJECTS = {
    "camera": "humans",
    "camera-few": "humans",
    "animals-few": "animals",
    **{f"humans-random[draw={draw}]": "humans-random" for draw in range(3)},
}

#: Sets with some of the poses of another one, of which no fold of poses can be told.
_FEWER_POSES = frozenset({"camera-few", "animals-few"})


def set_of_subjects(dataset: str) -> str | None:
    """Return the set of the catalogue whose subjects a set shows, changed in whatever way; None where nobody knows."""
    name = catalogued(dataset)
    return None if name is None else _SAME_SUBJECTS.get(name, name)


#: Name of the training on sampled bodies, and how many bodies in how many poses it takes by default.
SAMPLED = "humans-sampled"
SAMPLED_BODIES, SAMPLED_POSES = 1500, 6

#: Name of the training on sampled animals and people, and in how many poses each.
ANIMALS_SAMPLED, ANIMAL_POSES = "animals-sampled", 12

#: Trainings on as many bodies as are asked for.
COUNTED = frozenset({SAMPLED, ANIMALS_SAMPLED})

#: Name of the training on a stream of fresh bodies in free poses.
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
    """Subjects in words, places counted from 1."""
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
    """Training by name; raises ``ConfigurationError`` for an unknown one."""
    if name not in TRAININGS:
        raise did_you_mean("training", name, TRAININGS)
    return TRAININGS[name]


def with_validation(training: Training, n_subjects: int) -> Training:
    """Training without some of its subjects, which take the place of the tested ones in curves and pictures.

    What a choice between schedules or parameters is made by. The subjects to be tested are in neither part. The
    training subjects are cut into as many equal runs as subjects are held back, and of each run the next place is
    taken, from the first on; what is left over at the end stays in training. So, as with :func:`subject_fold`, neither
    a set that lists its kinds one after the other nor one that lists them in turn has one kind alone held back.

    Parameters
    ----------
    training
        The protocol.
    n_subjects
        How many subjects to hold back.

    Raises
    ------
    ConfigurationError
        If that would leave nothing to train on.
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
    """Trainings that give a learner its models for a data set: one for each fold of it, or one for all its shapes.

    People of a set without folds are strangers to the folds of the synthetic humans alike, so the first one's model
    treats them: scans of people get that of the set that is present, a folder of one's own that of the generated one.

    Parameters
    ----------
    learner
        The method; its parameter ``training``, where it has one and it is set, names the only training.
    dataset
        Name of the set.
    data_root
        The folder that holds the official sets.

    Raises
    ------
    NoFolds
        If the learner has a model for each fold and the set has none.
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
    """Training whose model treats each shape, by identifier; of several folds, the one that has not seen its subject.

    Parameters
    ----------
    learner, data_root
        See :func:`trainings_on`, which also says what is raised.
    dataset, entries
        The shapes.
    """
    entries = list(entries)
    trainings = trainings_on(learner, dataset.name, data_root)
    if len(trainings) == 1:
        return dict.fromkeys((entry.identifier for entry in entries), trainings[0])
    # Places of poses are those of the set that is trained on, of which another one may show some alone.
    if dataset.name != trainings[0].dataset:
        dataset = open_dataset(trainings[0].dataset, data_root)
    shapes = tuple((entry.identifier, entry.subject) for entry in dataset.entries)
    place = shapes, *(training.name for training in trainings)
    if place not in _OF_SHAPE:
        _OF_SHAPE[place] = {e.identifier: training for training in trainings for e in training.tested.of(dataset)}
    return {entry.identifier: _OF_SHAPE[place][entry.identifier] for entry in entries}


#: Training that is tested on each shape, by the shapes of a set and the names of the trainings: many rows share it.
_OF_SHAPE: dict[tuple[Any, ...], Mapping[str, Training]] = {}


def only_training(learner: Learner) -> Training | None:
    """Return the training of a learner that has the same one for every table; None if it has several."""
    if named := getattr(learner, "training", ""):
        return find_training(named)
    return TRAININGS[SAMPLED] if learner.split == "sampled" else None

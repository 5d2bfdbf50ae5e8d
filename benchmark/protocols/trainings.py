"""What learners are trained on, as data: which shapes of which set become pairs, and which never do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.catalogue import is_present
from benchmark.datasets.parts import Part
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.learning import Learner

__all__ = [
    "HELD_OUT",
    "NUMERALS",
    "SAMPLED",
    "SAMPLED_BODIES",
    "SAMPLED_POSES",
    "SUBJECT_FOLDS",
    "TEST_SUBJECTS",
    "TRAININGS",
    "NoFolds",
    "Training",
    "find_training",
    "fold",
    "trainings_by_shape",
    "trainings_of",
]


class NoFolds(ConfigurationError):
    """A learner has a model for each fold, and a set has no folds."""


@dataclass(frozen=True, kw_only=True)
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
        Shapes that become pairs.
    tested
        Shapes that the models are made for; the training data holds none of their subjects.
    """

    name: str
    words: str
    dataset: str
    trained: Part
    tested: Part


#: Tables of the paper.
NUMERALS = ("I", "II", "III", "IV")

#: Subjects and poses are cut into folds of this size by their place, as the paper's strict protocol needs.
FOLD = 5
SUBJECT_FOLDS, POSE_FOLDS = 3, 4

#: Training and test subjects of the synthetic humans by place; the paper tells their numbers but not which.
TRAIN_SUBJECTS, TEST_SUBJECTS = tuple(range(10)), tuple(range(10, 15))

#: Classes that the models of Table III are tested on; the paper trains on "other animals".
HELD_OUT = ("cat", "horse")
OTHER_ANIMALS = ("centaur", "dog", "gorilla", "wolf")
PEOPLE = ("david", "michael", "victoria")

#: Which of the two trainings on animals a table-bound learner uses by default: "III" or "III-people".
TABLE_III = "III"

#: Name of the training on sampled bodies, and how many bodies in how many poses it takes by default.
SAMPLED = "humans-sampled"
SAMPLED_BODIES, SAMPLED_POSES = 1500, 6


def strict_name(dataset: str, subjects: int, poses: int) -> str:
    """Name of the strict training that leaves out one fold of subjects and one of poses."""
    return f"{dataset}-strict-{subjects}-{poses}"


def fold(number: int) -> tuple[int, ...]:
    """Places of the subjects, or of the poses, in a fold."""
    return tuple(range(number * FOLD, (number + 1) * FOLD))


def _others(number: int, folds: int) -> tuple[int, ...]:
    return tuple(place for place in range(folds * FOLD) if place not in fold(number))


def _of_humans(dataset: str) -> Iterator[Training]:
    yield Training(
        name=f"{dataset}-I",
        words="subjects 1 to 10 in all poses",
        dataset=dataset,
        trained=Part(TRAIN_SUBJECTS),
        tested=Part(TEST_SUBJECTS),
    )
    for subjects in range(SUBJECT_FOLDS):
        for poses in range(POSE_FOLDS):
            yield Training(
                name=strict_name(dataset, subjects, poses),
                words=f"all but subjects {_range(subjects)} and poses {_range(poses)}",
                dataset=dataset,
                trained=Part(_others(subjects, SUBJECT_FOLDS), _others(poses, POSE_FOLDS)),
                tested=Part(fold(subjects), fold(poses)),
            )


def _range(number: int) -> str:
    return f"{number * FOLD + 1} to {(number + 1) * FOLD}"


def _of_animals(dataset: str) -> Iterator[Training]:
    for suffix, classes in ("III", OTHER_ANIMALS), ("III-people", (*OTHER_ANIMALS, *PEOPLE)):
        yield Training(
            name=f"{dataset}-{suffix}",
            words=f"{', '.join(sorted(classes))} in all poses",
            dataset=dataset,
            trained=Part(classes),
            tested=Part(HELD_OUT),
        )


TRAININGS: Mapping[str, Training] = {
    training.name: training
    for training in (
        *_of_humans("shrec14-synthetic"),
        *_of_humans("humans"),
        *_of_animals("tosca"),
        *_of_animals("animals"),
        Training(
            name=SAMPLED,
            words="sampled bodies that are none of the data set's",
            dataset="humans",
            trained=Part(),
            tested=Part(TEST_SUBJECTS),
        ),
    )
}
"""All protocols by name."""


def find_training(name: str) -> Training:
    """Training by name; raises ``ConfigurationError`` for an unknown one."""
    if name not in TRAININGS:
        raise did_you_mean("training", name, TRAININGS)
    return TRAININGS[name]


def trainings_of(learner: Learner, table: str, data_root: Path | None) -> dict[str, Training]:
    """Trainings by name that give a learner its models for a table of the paper.

    Parameters
    ----------
    learner
        The method; its parameter ``training``, where it has one and it is set, names the only training.
    table
        Numeral of the table; of no account for a learner whose split is not that of the table.
    data_root
        The folder that holds the official sets.

    Raises
    ------
    ConfigurationError
        If the training or the table is unknown.
    """
    if always := _whatever_the_table(learner):
        return {always.name: always}
    synthetic = _present("shrec14-synthetic", "humans", data_root)
    if table not in NUMERALS:
        raise did_you_mean("table", table, NUMERALS)
    if learner.split == "strict":
        names = [strict_name(synthetic, a, b) for a in range(SUBJECT_FOLDS) for b in range(POSE_FOLDS)]
    elif table == "III":
        names = [f"{_present('tosca', 'animals', data_root)}-{TABLE_III}"]
    else:
        names = [f"{synthetic}-I"]
    return {name: TRAININGS[name] for name in names}


def trainings_by_shape(
    learner: Learner, dataset: Dataset, entries: Iterable[Entry], data_root: Path | None
) -> dict[str, Training]:
    """Training whose model treats each shape, by identifier.

    A set that no protocol trains on gets the models of the synthetic humans: scans of people those of the set that is
    present, a folder of one's own those of the generated one.

    Parameters
    ----------
    learner
        The method; its parameter ``training``, where it has one and it is set, overrides the protocol.
    dataset, entries
        The shapes.
    data_root
        The folder that holds the official sets.

    Raises
    ------
    NoFolds
        If the learner has a model for each fold and the set has none.
    ConfigurationError
        If the training is unknown.
    """
    if not (always := _whatever_the_table(learner)) and learner.split == "strict":
        folds = [
            TRAININGS.get(strict_name(dataset.name, a, b)) for a in range(SUBJECT_FOLDS) for b in range(POSE_FOLDS)
        ]
        of_shape = {entry.identifier: known for known in folds if known for entry in known.tested.of(dataset)}
        if not of_shape:
            raise NoFolds(f"the set '{dataset.name}' has no folds of subjects and poses", "use the synthetic humans")
        return {entry.identifier: of_shape[entry.identifier] for entry in entries}
    return dict.fromkeys((entry.identifier for entry in entries), always or _of_set(dataset.name, data_root))


def _of_set(name: str, data_root: Path | None) -> Training:
    if name in ("tosca", "animals"):
        return TRAININGS[f"{name}-{TABLE_III}"]
    if name == "shrec14-real":
        return TRAININGS[f"{_present('shrec14-synthetic', 'humans', data_root)}-I"]
    return TRAININGS.get(f"{name}-I", TRAININGS["humans-I"])


def _whatever_the_table(learner: Learner) -> Training | None:
    if named := getattr(learner, "training", ""):
        return find_training(named)
    return TRAININGS[SAMPLED] if learner.split == "sampled" else None


def _present(official: str, stand_in: str, data_root: Path | None) -> str:
    return official if is_present(official, data_root) else stand_in

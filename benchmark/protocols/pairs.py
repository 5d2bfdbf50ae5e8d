"""Pairs of a training: shapes with their canonical poses, as learners get them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.learning import FROZEN_AT, Bodies, Learner, TrainingData, TrainingPair, digest_of
from benchmark.code_digest import code_digest
from benchmark.datasets import sampled
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.bodies import SUBJECTS
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.people import CLEARANCE, JUDGES, PEOPLE, TESTED, clearances
from benchmark.errors import ConfigurationError, ShapeError, check_known
from benchmark.pipeline.environment import commit
from benchmark.pipeline.prepared import frame_of
from benchmark.pipeline.views import prepare_view
from benchmark.protocols.galleries import galleries
from benchmark.protocols.trainings import (
    SAMPLED_PEOPLE,
    TRAININGS,
    Training,
    trainings_by_shape,
)
from benchmark.reference.paper import NUMERALS

Say = Callable[[str], None]

VALIDATION = "people[n=22]"
"""Set of new people, far from all tested ones.

Trainings on people are validated on the last ten in every fifth pose. The first twelve judge
experiments with networks, and no training sees them.
"""

_EVERY = 5
"""One of so many shapes validates."""

_PHENOTYPES = {**SUBJECTS["people[draw=0]"], **SUBJECTS["animals"]}
"""Bodies of the people in sets that are trained on."""


def trainings_of(learner: Learner, target: str, data_root: Path | None) -> list[Training]:
    """Return the trainings of a learner for a table of the paper, or the one of this name."""
    if target in TRAININGS:
        return [TRAININGS[target]]
    check_known("table or training", [target], [*NUMERALS, *TRAININGS])
    trainings: dict[Training, None] = {}
    for gallery in galleries([target], data_root=data_root):
        of_shapes = trainings_by_shape(learner, gallery.dataset, gallery.entries, data_root)
        trainings.update(dict.fromkeys(of_shapes.values()))
    return list(trainings)


def data_of_training(training: Training, data_root: Path | None, say: Say) -> TrainingData:
    """Return the training data of a network: depth images of shapes and of their canonical poses.

    They are rendered later, when the training reads them.

    Parameters
    ----------
    training
        Says which subjects of which data set are trained on, and which are kept for the test.
    data_root
        The folder of the official data sets.
    say
        Called with a message about each shape that cannot be rendered.

    Raises
    ------
    DatasetError
        If the data set is missing.
    ConfigurationError
        If the training data would include a test subject, or would be empty.
    """
    if training.is_frozen:
        problem = f"the bodies of '{training.name}' are not generated any more"
        raise ConfigurationError(problem, f"take its model, or train at commit {FROZEN_AT}")
    dataset = open_dataset(training.dataset, data_root)
    if training.name == SAMPLED_PEOPLE:
        return _sampled(dataset, say)
    trained = training.trained.of(dataset)
    tested = training.tested.of(dataset)
    subjects = _subjects(trained)
    tested_subjects = _subjects(tested)
    _check_subjects(training.name, subjects, tested_subjects)
    # The training sees its shapes, and the canonical pose of each of their subjects.
    canonical = canonical_shapes(dataset)
    canonical_of_subjects = [canonical[subject] for subject in subjects]
    seen = dict.fromkeys([*trained, *canonical_of_subjects])

    # A training on generated people is validated on others, so that it never sees its test.
    validation_set: ShapeSet = dataset
    held_out: Sequence[Entry] = tested
    if set(subjects) <= set(PEOPLE[0]):
        validation_set, held_out = _validation()
    return TrainingData(
        name=training.name,
        title=f"{dataset.title}, {training.words}",
        subjects=subjects,
        identifiers=tuple(entry.identifier for entry in seen),
        tested=digest_of(tested_subjects),
        pairs=lambda: _rendered(trained, dataset, frame_of(dataset), say),
        n_pairs=len(trained),
        validation=lambda: _rendered(held_out, validation_set, frame_of(dataset), say),
        n_validation=len(held_out),
        clearance=_clearances(subjects, dataset.name),
        commit=commit(),
    )


def _subjects(entries: Iterable[Entry]) -> tuple[str, ...]:
    """Return the subjects of shapes in their order."""
    return tuple(dict.fromkeys(entry.subject for entry in entries))


def _validation() -> tuple[ShapeSet, Sequence[Entry]]:
    """Return the set and the shapes on which trainings on people are validated."""
    new = open_dataset(VALIDATION)
    judges = {entry.subject for entry in open_dataset(JUDGES).shapes}
    others = [entry for entry in new.shapes if entry.subject not in judges]
    return new, others[::_EVERY]


def _check_subjects(name: str, trained: Iterable[str], tested: Iterable[str]) -> None:
    """Check that a training has subjects, and none of those on which its models are tested.

    Parameters
    ----------
    name
        Name of the training.
    trained, tested
        The subjects.

    Raises
    ------
    ConfigurationError
        If there are no subjects, or some of the test, which the error names.
    """
    trained = set(trained)
    if not trained:
        raise ConfigurationError(
            f"training '{name}' has no pairs", "check the data set with 'data check'"
        )
    in_both = sorted(trained & set(tested))
    if in_both:
        some = ", ".join(in_both[:5])
        problem = f"training '{name}' would include test subjects of its models: {some}"
        raise ConfigurationError(problem, "keep the subjects of the data set apart")


def _sampled(frame: ShapeSet, say: Say) -> TrainingData:
    """Return the training data of random people, each in the canonical pose and in random ones.

    Parameters
    ----------
    frame
        Data set on which the network will be used. Images get the frame of its views.
    say
        Called with a message about each shape of the validation that cannot be rendered.
    """
    half_width = frame_of(frame)
    validation_set, held_out = _validation()
    # The recipe, with a digest of the code, says whether images on disk are still the same.
    code = code_digest(sampled.__name__)
    names = tuple(f"sample-{number}" for number in range(sampled.N_BODIES))
    bodies = Bodies(
        names=names,
        n_images=sampled.N_SHAPES,
        images=partial(sampled.sampled_images, half_width=half_width),
        recipe=f"{len(names)} bodies x {sampled.N_SHAPES}, {half_width}, {code}",
    )
    title = f"{len(names)} random people in the canonical pose and {sampled.N_POSES} random ones"
    return TrainingData(
        name=SAMPLED_PEOPLE,
        title=title,
        subjects=(f"{names[0]} to {names[-1]}",),
        identifiers=(f"{names[0]}_0 to {names[-1]}_{sampled.N_POSES}",),
        tested="",
        pairs=bodies.pairs,
        n_pairs=len(names) * sampled.N_SHAPES,
        validation=lambda: _rendered(held_out, validation_set, half_width, say),
        n_validation=len(held_out),
        clearance=dict.fromkeys(sampled.AWAY_FROM, CLEARANCE),
        commit=commit(),
        bodies=bodies,
        extra_data=True,
    )


def _clearances(subjects: Sequence[str], dataset: str) -> dict[str, float]:
    """Return the clearances of the bodies.

    Those of ``people`` are clearances from each draw, because draws are not kept apart.
    """
    bodies = [_PHENOTYPES[name] for name in subjects if name in _PHENOTYPES]
    if not bodies:
        return {}
    sets = [name for name in TESTED if name != "people"]
    if dataset.startswith("people"):
        sets += [f"people[draw={draw}]" for draw in range(len(PEOPLE))]
    else:
        sets.append("people")
    return clearances(bodies, sets)


def _rendered(
    entries: Iterable[Entry], dataset: ShapeSet, half_width: float, say: Say
) -> Iterator[TrainingPair]:
    """Render depth images of shapes, each paired with that of the canonical pose of its subject.

    Parameters
    ----------
    entries
        The shapes.
    dataset
        Their data set.
    half_width
        Half the width of the frame of each image, in units of the files.
    say
        Called with a message about each shape that cannot be rendered, and is passed over.
    """
    canonical = canonical_shapes(dataset)

    # Shapes of one subject follow each other, and have one target, which is rendered once.
    @lru_cache(maxsize=32)
    def render(entry: Entry) -> NDArray[np.float32]:
        """Return the depth image of a shape."""
        mesh = dataset.load(entry)
        view = prepare_view(mesh, dataset.camera(entry), half_width, dataset.sensor(entry))
        return view["depth"]

    for entry in entries:
        target = canonical[entry.subject]
        try:
            image = render(entry)
            canonical_image = render(target)
        except ShapeError as error:
            say(f"skipped {entry.identifier}: {error}")
            continue
        yield TrainingPair(
            identifier=entry.identifier,
            subject=entry.subject,
            target_identifier=target.identifier,
            image=image,
            target=canonical_image,
        )

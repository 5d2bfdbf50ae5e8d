"""Training pairs of learners: the shapes of a protocol with their canonical poses, as methods get them.

Each time, it is checked that they include no test shape and no other shape of a test subject.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import MakesPairs, TrainingData, TrainingPair
from benchmark.datasets.animals.dataset import BODIES
from benchmark.datasets.base import Entry
from benchmark.datasets.catalogue import canonical_entry, open_dataset
from benchmark.datasets.human_subjects import SUBJECTS, Subject, clearances
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.pipeline.method_run import Preparation, require_arrays
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.store import Store
from benchmark.protocols.pairs.synthetic import sampled_data, varied_data
from benchmark.protocols.trainings import SAMPLED_BODIES, VARIED, Training

__all__ = ["training_data"]

_PHENOTYPES: Mapping[str, Mapping[str, Subject]] = {"humans": SUBJECTS, "animals": BODIES}
"""Bodies of the people in sets that are trained on."""


def training_data(
    training: Training,
    store: Store,
    data_root: Path | None,
    say: Callable[[str], None],
    n_sampled: int = SAMPLED_BODIES,
) -> TrainingData:
    """Render the shapes of a protocol and make its pairs.

    Parameters
    ----------
    training
        The protocol.
    store
        Where images are stored.
    data_root
        The folder of the official data sets.
    say
        Callback for messages about shapes that cannot be rendered and sampled bodies that are drawn again.
    n_sampled
        Number of bodies, if they are sampled.

    Raises
    ------
    DatasetError
        If the data set is missing.
    ConfigurationError
        If the training data would include a test subject, or would be empty.
    """
    dataset = open_dataset(training.dataset, data_root)
    preparation = Preparation(dataset, "view", store)
    tested = training.tested.of(dataset)

    def unseen(start: int = 0) -> Iterator[TrainingPair]:
        return _pairs(_renderable(tested, preparation, say)[start:], preparation)

    if training.name == VARIED:
        data: TrainingData = varied_data(training, unseen)
    elif training.is_sampled:
        data = sampled_data(training, n_sampled, preparation, unseen, say)
    else:
        data = _rendered_data(training, preparation, unseen, say)
    _check_apart(data, tested)
    return data


def _rendered_data(
    training: Training, preparation: Preparation, unseen: MakesPairs, say: Callable[[str], None]
) -> TrainingData:
    """Return the pairs of a data set."""
    dataset = preparation.dataset
    pairs = _renderable(training.trained.of(dataset), preparation, say)
    subjects = tuple(dict.fromkeys(entry.subject for pair in pairs for entry in pair))
    phenotypes = _PHENOTYPES.get(dataset.name, {})
    bodies = [phenotypes[name] for name in subjects if name in phenotypes]
    return TrainingData(
        name=training.name,
        title=f"{dataset.title}, {training.words}",
        digest=keys.digest([[preparation.recipe(entry) for entry in pair] for pair in pairs]),
        subjects=subjects,
        identifiers=tuple(dict.fromkeys(entry.identifier for pair in pairs for entry in pair)),
        n_pairs=len(pairs),
        pairs=lambda start=0: _pairs(pairs[start:], preparation),
        unseen=unseen,
        clearance=clearances(bodies) if bodies else {},
    )


def _renderable(
    entries: Iterable[Entry], preparation: Preparation, say: Callable[[str], None]
) -> list[tuple[Entry, Entry]]:
    """Return shapes with their subjects in the canonical pose, without those that cannot be rendered."""

    @cache
    def can_be_rendered(entry: Entry) -> bool:
        try:
            preparation.shape(entry)
        except ShapeError as error:
            say(f"skipped {entry.identifier}: {error}")
            return False
        return True

    pairs = [(entry, canonical_entry(preparation.dataset, entry.subject)) for entry in entries]
    return [pair for pair in pairs if all(can_be_rendered(entry) for entry in pair)]


def _pairs(pairs: Iterable[tuple[Entry, Entry]], preparation: Preparation) -> Iterator[TrainingPair]:
    targets: dict[str, NDArray[np.float32]] = {}
    for entry, target in pairs:
        if target.identifier not in targets:
            targets[target.identifier] = require_arrays(preparation.artefact(target))["depth"]
        yield TrainingPair(
            identifier=entry.identifier,
            subject=entry.subject,
            target_identifier=target.identifier,
            image=require_arrays(preparation.artefact(entry))["depth"],
            target=targets[target.identifier],
        )


def _check_apart(data: TrainingData, tested: Iterable[Entry]) -> None:
    """Raise ``ConfigurationError`` if there are no pairs or one of them shows a test subject."""
    if not data.n_pairs:
        raise ConfigurationError(f"training '{data.name}' has no pairs", "check the data set with 'data check'")
    both = sorted({entry.subject for entry in tested} & set(data.subjects)) + sorted(
        {entry.identifier for entry in tested} & set(data.identifiers)
    )
    if both:
        raise ConfigurationError(
            f"training '{data.name}' would include test shapes of its models: {', '.join(both[:5])}",
            "keep the subjects of the data set apart",
        )

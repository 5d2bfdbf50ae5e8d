"""Pairs that learners are trained on: the shapes of a protocol, rendered as every method is given them.

That no shape to be tested, nor another shape of its subject, is among them is checked each time they are made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.api.learning import MakesPairs, TrainingData, TrainingPair
from benchmark.datasets.animals.people import BODIES
from benchmark.datasets.base import Entry
from benchmark.datasets.catalogue import canonical_entry, open_dataset
from benchmark.datasets.human_subjects import SUBJECTS, Subject, clearances
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.pipeline.preparation import Preparation
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.store import Store
from benchmark.protocols.pairs.animals import sampled_animals
from benchmark.protocols.pairs.people import sampled_people
from benchmark.protocols.pairs.stream import varied_data
from benchmark.protocols.pairs.synthetic import Say, SyntheticTraining
from benchmark.protocols.trainings import ANIMALS_SAMPLED, SAMPLED, SAMPLED_BODIES, VARIED, Training

__all__ = ["training_data"]

_SYNTHETIC_SETS: Mapping[str, Callable[[SyntheticTraining, MakesPairs], TrainingData]] = {
    SAMPLED: sampled_people,
    ANIMALS_SAMPLED: sampled_animals,
    VARIED: varied_data,
}
"""Makers of data that is in no set, by the name of the training."""

_PHENOTYPES: Mapping[str, Mapping[str, Subject]] = {"humans": SUBJECTS, "animals": BODIES}
"""Bodies of the people in sets that are trained on."""


def training_data(
    training: Training, store: Store, data_root: Path | None, say: Say, n_sampled: int = SAMPLED_BODIES
) -> TrainingData:
    """Render the shapes of a protocol and make its pairs.

    Parameters
    ----------
    training
        The protocol.
    store
        Where images are kept.
    data_root
        The folder that holds the official sets.
    say
        Told about shapes that cannot be rendered, and about sampled bodies that are drawn again.
    n_sampled
        Number of bodies where they are sampled.

    Raises
    ------
    DatasetError
        If the set is absent.
    ConfigurationError
        If the training data would hold a subject that its models are tested on, or nothing at all.
    """
    dataset = open_dataset(training.dataset, data_root)
    preparation = Preparation(dataset, "view", store)
    tested = training.tested.of(dataset)

    def unseen(start: int = 0) -> Iterator[TrainingPair]:
        return _pairs(_renderable(tested, preparation, say)[start:], preparation)

    if synthetic := _SYNTHETIC_SETS.get(training.name):
        data = synthetic(SyntheticTraining(training, dataset, preparation.half_width, n_sampled, say), unseen)
    else:
        pairs = _renderable(training.trained.of(dataset), preparation, say)
        phenotypes = _PHENOTYPES.get(dataset.name, {})
        bodies = [phenotypes[name] for name in dict.fromkeys(each.subject for each, _ in pairs) if name in phenotypes]
        shown = list({entry.identifier: entry for pair in pairs for entry in pair}.values())
        data = TrainingData(
            name=training.name,
            title=f"{dataset.title}, {training.words}",
            digest=keys.digest([[preparation.recipe(entry) for entry in pair] for pair in pairs]),
            subjects=tuple(dict.fromkeys(entry.subject for entry in shown)),
            identifiers=tuple(entry.identifier for entry in shown),
            n_pairs=len(pairs),
            pairs=lambda start=0: _pairs(pairs[start:], preparation),
            unseen=unseen,
            clearance=clearances(bodies) if bodies else {},
        )
    _check_apart(data, tested)
    return data


def _renderable(entries: Iterable[Entry], preparation: Preparation, say: Say) -> list[tuple[Entry, Entry]]:
    """Shapes beside those of the same subject in the canonical pose, without those that cannot be rendered."""
    told: set[str] = set()

    def can_be_rendered(entry: Entry) -> bool:
        try:
            preparation.shape(entry)
        except ShapeError as error:
            if entry.identifier not in told:
                say(f"skipped {entry.identifier}: {error}")
            told.add(entry.identifier)
            return False
        return True

    beside = [(entry, canonical_entry(preparation.dataset, entry.subject)) for entry in entries]
    return [pair for pair in beside if all(can_be_rendered(entry) for entry in pair)]


def _pairs(pairs: Iterable[tuple[Entry, Entry]], preparation: Preparation) -> Iterator[TrainingPair]:
    targets: dict[str, NDArray[np.float32]] = {}
    for entry, target in pairs:
        if target.identifier not in targets:
            targets[target.identifier] = _image(preparation, target)
        yield TrainingPair(
            identifier=entry.identifier,
            subject=entry.subject,
            target_identifier=target.identifier,
            image=_image(preparation, entry),
            target=targets[target.identifier],
        )


def _image(preparation: Preparation, entry: Entry) -> NDArray[np.float32]:
    """The image that methods are given, from the store."""
    image = preparation.shape(entry).depth
    if image is None:
        raise ConfigurationError(f"{entry.identifier} has no depth image", "train on the view input")
    return image


def _check_apart(data: TrainingData, tested: Iterable[Entry]) -> None:
    """Raise ``ConfigurationError`` unless there are pairs and none of them shows a subject to be tested."""
    if not data.n_pairs:
        raise ConfigurationError(f"training '{data.name}' has no pairs", "check the data set with 'data check'")
    both = sorted({entry.subject for entry in tested} & set(data.subjects)) + sorted(
        {entry.identifier for entry in tested} & set(data.identifiers)
    )
    if both:
        raise ConfigurationError(
            f"training '{data.name}' would show what its models are tested on: {', '.join(both[:5])}",
            "keep the subjects of the data set apart",
        )

"""Training pairs of learners: the shapes of a protocol with their canonical poses, as methods get them.

Each time, it is checked that they include no test shape and no other shape of a test subject.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.learning import TrainingData, TrainingPair, digest_of
from benchmark.datasets.animals.dataset import BODIES
from benchmark.datasets.catalogue import canonical_entry, open_dataset
from benchmark.datasets.human_subjects import PEOPLE, SUBJECTS, clearances
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.geometry.depth import DepthImage
from benchmark.pipeline.stages.shapes import frame_of, half_width_of, seen
from benchmark.protocols.trainings import Training

Shapes = Sequence[tuple[Entry, Entry]]
"""Shapes, each with that of its subject in the canonical pose."""

_PHENOTYPES = {**SUBJECTS, **PEOPLE[0], **BODIES}
"""Bodies of the people in sets that are trained on."""


def training_data(training: Training, data_root: Path | None, say: Callable[[str], None]) -> TrainingData:
    """Return the pairs of a protocol, which are rendered when they are read.

    Parameters
    ----------
    training
        The protocol.
    data_root
        The folder of the official data sets.
    say
        Callback for messages about shapes that cannot be rendered.

    Raises
    ------
    DatasetError
        If the data set is missing.
    ConfigurationError
        If the training data would include a test subject, or would be empty.
    """
    if training.is_sampled:
        raise ConfigurationError(f"the bodies of '{training.name}' are not generated any more", "take its model")
    dataset = open_dataset(training.dataset, data_root)
    tested = training.tested.of(dataset)
    pairs, others = (_with_targets(part.of(dataset), dataset) for part in (training.trained, training.tested))
    subjects = tuple(dict.fromkeys(entry.subject for entry, _ in pairs))
    bodies = [_PHENOTYPES[name] for name in subjects if name in _PHENOTYPES]
    data = TrainingData(
        name=training.name,
        title=f"{dataset.title}, {training.words}",
        subjects=subjects,
        identifiers=tuple(dict.fromkeys(entry.identifier for pair in pairs for entry in pair)),
        tested=digest_of({entry.subject for entry in tested}),
        pairs=lambda: _rendered(pairs, dataset, say),
        n_pairs=len(pairs),
        validation=lambda: _rendered(others, dataset, say),
        n_validation=len(others),
        clearance=clearances(bodies) if bodies else {},
    )
    _check_apart(data, tested)
    return data


def _with_targets(entries: Iterable[Entry], dataset: ShapeSet) -> Shapes:
    target = cache(lambda subject: canonical_entry(dataset, subject))
    return [(entry, target(entry.subject)) for entry in entries]


def _rendered(shapes: Shapes, dataset: ShapeSet, say: Callable[[str], None]) -> Iterator[TrainingPair]:
    """Yield the pairs, without those that cannot be rendered."""
    half_width = dataset.half_width or _fitted_half_width(dataset)

    @lru_cache(maxsize=32)  # the shapes of a subject are adjacent, and share a target
    def render(entry: Entry) -> DepthImage:
        return seen(dataset.load(entry), dataset.camera(entry), half_width)["depth"]

    for entry, target in shapes:
        try:
            image, canonical = render(entry), render(target)
        except ShapeError as error:
            say(f"skipped {entry.identifier}: {error}")
            continue
        yield TrainingPair(
            identifier=entry.identifier,
            subject=entry.subject,
            target_identifier=target.identifier,
            image=image,
            target=canonical,
        )


def _fitted_half_width(dataset: ShapeSet) -> float:
    widths = []
    for entry in dataset.shapes:
        with suppress(ShapeError):
            widths.append(half_width_of(dataset.load(entry), dataset.camera(entry)))
    return frame_of(widths)


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

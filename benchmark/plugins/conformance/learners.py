"""A model for a learner that has none: trained on a few images of the reference figure, to be checked with it."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Method
from benchmark.api.learning import CARD, Learner, TrainingData, TrainingPair, checked_weights, read_card
from benchmark.plugins.conformance.cases import Failed
from benchmark.plugins.conformance.shapes import BENDS, view
from benchmark.plugins.registry import MethodSpec

__all__ = ["case_data", "trained"]

#: Name of the training, and so of the folder that holds the models.
NAME = "case"


def case_data() -> TrainingData:
    """Depth images of the figure in its poses, the first of which is the canonical one; all that training may see."""

    def pairs(start: int = 0) -> Iterator[TrainingPair]:
        target = view(BENDS[0]).depth
        for bend in itertools.islice(BENDS, start, None):
            image = view(bend).depth
            if image is not None and target is not None:
                yield TrainingPair(
                    identifier=f"figure {bend}",
                    subject="figure",
                    target_identifier=f"figure {BENDS[0]}",
                    image=image,
                    target=target,
                )

    names = tuple(f"figure {bend}" for bend in BENDS)
    return TrainingData(
        name=NAME,
        title="the reference figure",
        digest=hashlib.sha256(" ".join(names).encode()).hexdigest(),
        subjects=("figure",),
        identifiers=names,
        n_pairs=len(BENDS),
        pairs=pairs,
        unseen=pairs,
    )


def trained(spec: MethodSpec, folder: Path, options: Mapping[str, Any] | None = None) -> Method:
    """Train a learner on :func:`case_data` and load the model.

    Parameters
    ----------
    spec
        The learner.
    folder
        Where its models go.
    options
        Deviations from its own schedule.

    Raises
    ------
    Failed
        If no model comes of it that the harness could use, or it is trained anew though it is finished.
    """
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise Failed("has 'train' but is no learner; see 'A learner' in docs/reference/plugins.md")
    place, data = folder / NAME / learner.model_name, case_data()
    learner.train(data, place, dict(options or {}), lambda _: None)
    card = _card(place)
    learner.train(data, place, dict(options or {}), lambda _: None)
    if _card(place) != card:
        raise Failed("trains a finished model again; leave one alone whose card is there")
    checked_weights(place)
    if card["data"] != data.name or set(card["identifiers"]) != set(data.identifiers):
        raise Failed("the card does not name the training data and all its identifiers; copy them from what is passed")
    check_card = getattr(learner, "check_card", None)
    if check_card is not None:
        check_card(card, place)
    loaded: Method = learner.load(place)
    if type(loaded) is not type(learner):
        raise Failed(f"'load' returns {type(loaded).__name__}; return the method with its model")
    return loaded


def _card(place: Path) -> dict[str, Any]:
    if not (place / CARD).is_file():
        raise Failed(f"'train' ends without {CARD}; write it last, for it means that the model is finished")
    return read_card(place)

"""Scores of galleries whose forms come from one network or from four: ``python -m tools.mixtures FOLD``, four minutes.

The strict row of Table IV ranks forms of four networks, one for each group of poses; the 15 subjects of Table I-view
forms of three, one for each group of subjects. Here four trainings of one network, none of which has seen the subjects,
share a gallery of five subjects in the same ways.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from pathlib import Path

import numpy as np

from benchmark.api.scoring import Mesh, SignatureArrays
from benchmark.datasets.base import Part
from benchmark.datasets.catalogue import open_dataset
from benchmark.pipeline.cache import Cache
from benchmark.pipeline.stages import Preparation, compute_form, compute_signature, shape_of
from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.protocols.trainings import POSE_FOLDS, SUBJECT_FOLDS
from benchmark.reference.paper import MEASURES
from learned.methods import Learned
from retrieval.cmbof import CMBOF
from retrieval.measures import score_draws

MODELS = ("literal-seed0", "literal-seed1", "without_weighting-seed0", "without_weighting-seed1")

#: Galleries with one network, one for each group of poses, and one for each subject: network by pose and subject.
WAYS: Mapping[str, Callable[[int, int], int]] = {
    "one network": lambda pose, subject: 0,
    "one for each group of poses": lambda pose, subject: pose // len(POSE_FOLDS[0]),
    "one for each subject": lambda pose, subject: subject,
}


def scores(fold: int, folder: Path = Path("results")) -> Iterator[tuple[str, str, float]]:
    """Yield the way, measure and mean score over four shifts of the networks, on the subjects of a fold."""
    dataset, scorer = open_dataset(SYNTHETIC_HUMANS[0]), CMBOF()
    entries, cache = Part(SUBJECT_FOLDS[fold]).of(dataset), Cache(folder)
    preparation, signatures = Preparation(dataset, "view", cache), dict[tuple[int, int], SignatureArrays]()
    for model, (number, entry) in product(range(len(MODELS)), enumerate(entries)):
        method = Learned(configuration=MODELS[model].partition("-")[0])
        method = method.load(method.shipped_models / f"people-fold-{fold}" / MODELS[model])
        prepared = preparation.arrays(entry)
        form = compute_form(method, shape_of(prepared, entry.identifier))
        signatures[model, number] = compute_signature(scorer, Mesh(form.vertices, form.faces))
    labels = [entry.subject for entry in entries]
    places = [(labels[:k].count(label), sorted(set(labels)).index(label)) for k, label in enumerate(labels)]
    for way, network in WAYS.items():
        each = []
        for shift in range(len(MODELS)):
            chosen = [(network(*place) + shift) % len(MODELS) for place in places]
            mixed = [signatures[model, number] for number, model in enumerate(chosen)]
            found = score_draws((scorer.compare(mixed, draw) for draw in range(scorer.info.draws)), labels)["scores"]
            each.append([found[name] for name in MEASURES])
        yield from ((way, name, value) for name, value in zip(MEASURES, np.mean(each, axis=0), strict=True))


if __name__ == "__main__":
    for way, measure, value in scores(int(sys.argv[1])):
        print(f'mixtures,"fold {sys.argv[1]}, {way}",four trainings,60,{measure},{value:.4f}', flush=True)

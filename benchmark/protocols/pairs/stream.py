"""The stream of fresh bodies as training data: two streams that share no body, one to train on and one to choose by."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

from benchmark.api.learning import MakesPairs, TrainingPair
from benchmark.api.streaming import ScannedData, StreamedAndScannedData, StreamedData
from benchmark.datasets.human_subjects import CLEARANCE
from benchmark.datasets.scans.sampler import ScanSampler
from benchmark.datasets.varied.bodies import AWAY_FROM
from benchmark.datasets.varied.sampler import Sampler
from benchmark.datasets.varied.wide import WideSampler
from benchmark.geometry.depth import SIZE
from benchmark.pipeline.storage import keys
from benchmark.pipeline.storage.lock import versions_of
from benchmark.protocols.pairs.synthetic import SyntheticTraining

TRAINED, VALIDATED = 0, 1
"""Seeds of the streams."""

VIEWS = 2
"""Images of each pose in the wide stream."""

SAMPLE = 1024
"""Pairs for a learner that keeps all of its pairs in memory."""


def varied_data(asked: SyntheticTraining, unseen: MakesPairs) -> StreamedAndScannedData:
    """The streams of one protocol.

    Parameters
    ----------
    asked
        The protocol; the number of bodies is of no account.
    unseen
        Makes pairs of the subjects that are tested.
    """
    fresh, validation = Sampler(TRAINED), Sampler(VALIDATED)
    plain = StreamedData(
        name=asked.training.name,
        title="fresh bodies in free poses, none of them a subject of a generated set of people",
        digest=keys.digest([repr(fresh), repr(validation), SAMPLE, versions_of(["sampler/varied"])]),
        subjects=(f"varied-{TRAINED}-0-0 and all that follow",),
        identifiers=(f"varied-{TRAINED}-0-0 and all that follow",),
        n_pairs=SAMPLE,
        pairs=lambda start=0: _pairs(fresh, start),
        unseen=unseen,
        clearance=dict.fromkeys(AWAY_FROM, CLEARANCE),
        fresh=fresh,
        validation=validation,
        surfaces=fresh.surfaces,
        validation_surfaces=validation.surfaces,
    )
    wide = WideSampler(seed=TRAINED, views=VIEWS)
    wide_stream = replace(
        plain,
        title="fresh bodies in free poses from several sides, no subject and no authored pose of a generated set",
        digest=keys.digest([repr(wide), repr(validation), SAMPLE, versions_of(["sampler/wide"])]),
        subjects=(f"wide-{TRAINED}-0-0 and all that follow",),
        identifiers=(f"wide-{TRAINED}-0-0 and all that follow",),
        fresh=wide,
    )
    return StreamedAndScannedData(**vars(plain) | {"wide": wide_stream, "scanned": _scanned(plain)})


def _scanned(plain: StreamedData) -> ScannedData:
    """The stream of scans; the pairs are those of the plain one, for nobody who trains on scans looks at them."""
    scans, validation = ScanSampler(seed=TRAINED), ScanSampler(seed=VALIDATED)
    return ScannedData(
        name=plain.name,
        title="fresh bodies as scanners leave them, no subject, no authored pose and no scan of a generated set",
        digest=keys.digest([repr(scans), repr(validation), versions_of(["sampler/scans"])]),
        subjects=(f"scanned-{TRAINED}-0-0 and all that follow",),
        identifiers=(f"scanned-{TRAINED}-0-0 and all that follow",),
        n_pairs=plain.n_pairs,
        pairs=plain.pairs,
        unseen=plain.unseen,
        clearance=plain.clearance,
        scans=scans,
        validation=validation,
    )


def _pairs(sampler: Sampler, start: int) -> Iterator[TrainingPair]:
    first, skipped = divmod(start, sampler.poses)
    for number in range(first, SAMPLE // sampler.poses):
        fresh = sampler(number, 1, SIZE)
        (name,) = fresh.identifiers
        for place, image in itertools.islice(enumerate(fresh.images[0]), skipped, None):
            yield TrainingPair(
                identifier=f"{name}_{place}",
                subject=name,
                target_identifier=name,
                image=image,
                target=fresh.fronts[0],
            )
        skipped = 0

"""Bodies that differ as people do: by their phenotype, and by the proportions and girths of single parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmark.datasets.human_subjects import CLEARANCE, Subject, clearance

AWAY_FROM = ("humans", "humans-scanlike")
"""Sets whose subjects the bodies stay away from. With ``humans-random`` among them the streams would not be
those that networks were trained on and chosen by; so these are not tested on it."""

MOST_DRAWS = 10_000
"""Draws after which no body can be found; about one in two is far enough from all subjects."""

_CHILDREN, _ADULTS = (0.2, 0.5), (0.58, 1.0)
_LOWEST, _HIGHEST = (0.05, 0.05, 0.05, 0.05), (0.95, 0.98, 0.85, 0.98)
"""Ranges of muscle, weight, height and proportions."""

_BETWEEN_SHARE = 0.2
"""Share of adults between male and female, who are no test subject's neighbours and real bodies all the same."""

DEVIATION, LARGEST = 0.35, 0.9
"""Standard deviation and largest value of a local change; 1 is the end of what the body model was drawn for."""

PAIRED = (
    "lowerarm-fat-incr", "lowerarm-muscle-incr", "lowerarm-scale-vert-incr",
    "upperarm-fat-incr", "upperarm-muscle-incr", "upperarm-shoulder-muscle-incr", "upperarm-scale-vert-incr",
    "lowerleg-fat-incr", "lowerleg-muscle-incr", "lowerleg-scale-vert-incr", "leg-valgus-incr",
    "upperleg-fat-incr", "upperleg-muscle-incr", "upperleg-scale-vert-incr",
    "hand-scale-incr", "foot-scale-incr",
)  # fmt: skip
"""Local changes of the body model that have a left and a right."""

SINGLE = (
    "head-scale-vert-incr", "head-scale-depth-incr", "head-scale-horiz-incr", "head-fat-incr",
    "neck-scale-vert-incr", "neck-scale-horiz-incr", "neck-scale-depth-incr",
    "torso-scale-horiz-incr", "torso-scale-depth-incr", "torso-scale-vert-incr", "torso-vshape-incr",
    "torso-muscle-pectoral-incr", "torso-muscle-dorsi-incr", "measure-shoulder-dist-incr", "measure-waist-circ-incr",
    "hip-scale-horiz-incr", "hip-scale-depth-incr", "hip-scale-vert-incr", "hip-waist-up",
    "stomach-pregnant-incr", "stomach-tone-incr", "buttocks-volume-incr", "breast-volume-vert-up",
)  # fmt: skip
"""Local changes of the trunk and the head."""

LABELS = (*(f"{side}-{name}" for name in PAIRED for side in "lr"), *SINGLE)
"""All of them, by the names of the body model."""

_ASYMMETRY = 0.05
"""Standard deviation of the difference between left and right."""


@dataclass(frozen=True)
class Body:
    """A body.

    Parameters
    ----------
    subject
        Its phenotype.
    local
        A local change for each of :data:`LABELS`, in [-1, 1].
    """

    subject: Subject
    local: tuple[float, ...] = (0.0,) * len(LABELS)


def varied_body(random: np.random.Generator) -> Body:
    """Draw a body that is none of those that methods are tested on, a child as often as an adult.

    Parameters
    ----------
    random
        Source of the choice.
    """
    return Body(varied_subject(random), local_changes(random))


def varied_subject(random: np.random.Generator) -> Subject:
    """Draw a phenotype at a distance of ``CLEARANCE`` or more from the subjects of :data:`AWAY_FROM`."""
    for _ in range(MOST_DRAWS):
        child = random.random() < 0.5
        between = child or random.random() < _BETWEEN_SHARE
        gender = random.uniform() if between else float(random.integers(2))
        age = random.uniform(*(_CHILDREN if child else _ADULTS))
        # Rounded, so that a distance is no matter of last bits.
        values = np.round([gender, age, *random.uniform(_LOWEST, _HIGHEST)], 4).tolist()
        candidate = Subject(*values)
        if clearance(candidate, AWAY_FROM) >= CLEARANCE:
            return candidate
    raise AssertionError("the tested subjects leave no room")


def local_changes(random: np.random.Generator) -> tuple[float, ...]:
    """Draw a value for each of :data:`LABELS`; left and right differ little."""
    shared = np.repeat(random.normal(0, DEVIATION, len(PAIRED)), 2)
    sides = shared + random.normal(0, _ASYMMETRY, len(shared))
    values = np.concatenate([sides, random.normal(0, DEVIATION, len(SINGLE))])
    return tuple(np.round(np.clip(values, -LARGEST, LARGEST), 4).tolist())

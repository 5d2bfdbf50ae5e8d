"""Varied bodies: random phenotypes, and random proportions and girths of single parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmark.datasets.human_subjects import CLEARANCE, Subject, clearance

AWAY_FROM = ("humans", "humans-scanlike")
"""Sets with the subjects to avoid. Adding ``people`` would change the streams that the networks were trained on
and selected by, so these networks are not tested on it."""

MOST_DRAWS = 10_000
"""Maximum number of draws; about one body in two is far enough from all subjects."""

_CHILDREN, _ADULTS = (0.2, 0.5), (0.58, 1.0)
_LOWEST, _HIGHEST = (0.05, 0.05, 0.05, 0.05), (0.95, 0.98, 0.85, 0.98)
"""Ranges of muscle, weight, height and proportions."""

_BETWEEN_SHARE = 0.2
"""Fraction of adults between male and female: realistic bodies that are not close to any test subject."""

DEVIATION, LARGEST = 0.35, 0.9
"""Standard deviation and maximum of a local change; 1 is the limit of the range of the body model."""

PAIRED = (
    "lowerarm-fat-incr", "lowerarm-muscle-incr", "lowerarm-scale-vert-incr",
    "upperarm-fat-incr", "upperarm-muscle-incr", "upperarm-shoulder-muscle-incr", "upperarm-scale-vert-incr",
    "lowerleg-fat-incr", "lowerleg-muscle-incr", "lowerleg-scale-vert-incr", "leg-valgus-incr",
    "upperleg-fat-incr", "upperleg-muscle-incr", "upperleg-scale-vert-incr",
    "hand-scale-incr", "foot-scale-incr",
)  # fmt: skip
"""Local changes of the body model with a left and a right side."""

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
"""All local changes, by their names in the body model."""

_ASYMMETRY = 0.05
"""Standard deviation of the difference between left and right."""


@dataclass(frozen=True)
class Body:
    """A body.

    Parameters
    ----------
    subject
        Phenotype of the body.
    local
        Local change for each of :data:`LABELS`, in [-1, 1].
    """

    subject: Subject
    local: tuple[float, ...] = (0.0,) * len(LABELS)


def varied_body(random: np.random.Generator) -> Body:
    """Draw a body at a distance from the subjects of :data:`AWAY_FROM`, child or adult with equal probability.

    Parameters
    ----------
    random
        Random generator.
    """
    return Body(varied_subject(random), local_changes(random))


def varied_subject(random: np.random.Generator) -> Subject:
    """Draw a phenotype at a distance of at least ``CLEARANCE`` from the subjects of :data:`AWAY_FROM`."""
    for _ in range(MOST_DRAWS):
        child = random.random() < 0.5
        between = child or random.random() < _BETWEEN_SHARE
        gender = random.uniform() if between else float(random.integers(2))
        age = random.uniform(*(_CHILDREN if child else _ADULTS))
        # Rounded, so that rounding errors do not affect the comparison of distances.
        values = np.round([gender, age, *random.uniform(_LOWEST, _HIGHEST)], 4).tolist()
        candidate = Subject(*values)
        if clearance(candidate, AWAY_FROM) >= CLEARANCE:
            return candidate
    raise AssertionError("the tested subjects leave no room")


def local_changes(random: np.random.Generator) -> tuple[float, ...]:
    """Draw a value for each of :data:`LABELS`, with small differences between left and right."""
    shared = np.repeat(random.normal(0, DEVIATION, len(PAIRED)), 2)
    sides = shared + random.normal(0, _ASYMMETRY, len(shared))
    values = np.concatenate([sides, random.normal(0, DEVIATION, len(SINGLE))])
    return tuple(np.round(np.clip(values, -LARGEST, LARGEST), 4).tolist())

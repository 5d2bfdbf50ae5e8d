"""The bodies of the generated humans, as points of the model's space of phenotypes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass

import numpy as np


@dataclass(frozen=True)
class Subject:
    """A body; every value lies in [0, 1].

    Parameters
    ----------
    gender
        0 is male, 1 is female.
    age
        1/3 is a child, 2/3 a young adult, 1 old.
    muscle, weight, height
        0.5 is the average of that age and gender.
    proportions
        0 is uncommon, 1 ideal.
    """

    gender: float
    age: float
    muscle: float
    weight: float
    height: float
    proportions: float


SUBJECTS: Mapping[str, Subject] = {
    "man-1": Subject(gender=0.0, age=0.89, muscle=0.26, weight=0.43, height=0.24, proportions=0.81),
    "woman-1": Subject(gender=1.0, age=0.98, muscle=0.17, weight=0.36, height=0.67, proportions=0.08),
    "child-1": Subject(gender=1.0, age=0.38, muscle=0.50, weight=0.89, height=0.09, proportions=0.94),
    "man-2": Subject(gender=0.0, age=0.68, muscle=0.22, weight=0.96, height=0.08, proportions=0.38),
    "woman-2": Subject(gender=1.0, age=0.63, muscle=0.89, weight=0.93, height=0.48, proportions=0.10),
    "child-2": Subject(gender=1.0, age=0.34, muscle=0.40, weight=0.73, height=0.17, proportions=0.10),
    "man-3": Subject(gender=0.0, age=0.66, muscle=0.91, weight=0.22, height=0.42, proportions=0.18),
    "woman-3": Subject(gender=1.0, age=0.94, muscle=0.47, weight=0.32, height=0.36, proportions=0.94),
    "child-3": Subject(gender=0.0, age=0.35, muscle=0.21, weight=0.08, height=0.73, proportions=0.87),
    "child-4": Subject(gender=0.0, age=0.31, muscle=0.29, weight=0.50, height=0.08, proportions=0.67),
    "man-4": Subject(gender=0.0, age=0.98, muscle=0.92, weight=0.96, height=0.11, proportions=0.79),
    "woman-4": Subject(gender=1.0, age=0.90, muscle=0.40, weight=0.75, height=0.12, proportions=0.91),
    "child-5": Subject(gender=0.0, age=0.28, muscle=0.72, weight=0.83, height=0.36, proportions=0.77),
    "man-5": Subject(gender=0.0, age=0.74, muscle=0.57, weight=0.90, height=0.08, proportions=0.20),
    "woman-5": Subject(gender=1.0, age=0.71, muscle=0.86, weight=0.89, height=0.10, proportions=0.06),
}
"""The bodies, in the order of the data set: five men, five women and five children.

The values come from an exchange search over random bodies below two metres for the largest smallest difference between
two of them, measured where canonical forms look: geodesic distances between the same 50 points of the standing bodies,
scale removed. No score of a method went into it. Which subjects are tested together follows from their places in this
order alone, by a rule of the protocol that holds for the official set as well.
"""

_CHILDREN = (0.26, 0.48)
_ADULTS = (0.60, 1.0)
_LOWEST, _HIGHEST = (0.15, 0.14, 0.08, 0.12), (0.95, 0.95, 0.60, 0.95)
"""Ranges of muscle, weight, height and proportions: no walking skeletons, and nobody above two metres."""
_CLEARANCE = 0.25
"""Smallest Euclidean distance in phenotype space between a sampled body and those of the data set."""


def new_subject(random: np.random.Generator) -> Subject:
    """Draw a body that is none of :data:`SUBJECTS`.

    A third are men, a third women, a third children; everything else is uniform. Bodies nearer than 0.25 to one of the
    data set, measured in phenotype space, are drawn again.

    Parameters
    ----------
    random
        Source of the choice.
    """
    taken = np.array([astuple(subject) for subject in SUBJECTS.values()])
    while True:
        kind = random.integers(3)
        gender = random.uniform() if kind == 2 else float(kind)
        age = random.uniform(*(_CHILDREN if kind == 2 else _ADULTS))
        candidate = Subject(gender, age, *random.uniform(_LOWEST, _HIGHEST).tolist())
        if np.linalg.norm(taken - astuple(candidate), axis=1).min() >= _CLEARANCE:
            return candidate

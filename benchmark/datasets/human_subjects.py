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
    "man-1": Subject(gender=0.0, age=0.90, muscle=0.31, weight=0.15, height=0.54, proportions=0.39),
    "woman-1": Subject(gender=1.0, age=0.63, muscle=0.23, weight=0.14, height=0.39, proportions=0.22),
    "child-1": Subject(gender=0.0, age=0.33, muscle=0.25, weight=0.36, height=0.31, proportions=0.71),
    "man-2": Subject(gender=0.0, age=0.95, muscle=0.19, weight=0.80, height=0.25, proportions=0.78),
    "woman-2": Subject(gender=1.0, age=0.95, muscle=0.17, weight=0.94, height=0.37, proportions=0.87),
    "child-2": Subject(gender=0.0, age=0.33, muscle=0.81, weight=0.52, height=0.10, proportions=0.52),
    "man-3": Subject(gender=0.0, age=0.76, muscle=0.70, weight=0.75, height=0.19, proportions=0.13),
    "woman-3": Subject(gender=1.0, age=0.95, muscle=0.86, weight=0.26, height=0.31, proportions=0.89),
    "child-3": Subject(gender=1.0, age=0.40, muscle=0.20, weight=0.93, height=0.10, proportions=0.24),
    "child-4": Subject(gender=1.0, age=0.37, muscle=0.55, weight=0.18, height=0.14, proportions=0.77),
    "man-4": Subject(gender=0.0, age=0.97, muscle=0.78, weight=0.76, height=0.51, proportions=0.88),
    "woman-4": Subject(gender=1.0, age=0.60, muscle=0.64, weight=0.83, height=0.60, proportions=0.24),
    "child-5": Subject(gender=1.0, age=0.32, muscle=0.91, weight=0.24, height=0.23, proportions=0.16),
    "man-5": Subject(gender=0.0, age=0.68, muscle=0.44, weight=0.21, height=0.35, proportions=0.39),
    "woman-5": Subject(gender=1.0, age=0.63, muscle=0.17, weight=0.79, height=0.31, proportions=0.15),
}
"""The bodies, in the order of the data set.

Training subjects (0 to 9) and test subjects (10 to 14) both hold men, women and children. The values come from an
exchange search over random bodies of usual height for the largest smallest distance between two of the same area.
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

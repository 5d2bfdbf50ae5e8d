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
    "man-1": Subject(gender=0.0, age=0.90, muscle=0.24, weight=0.06, height=0.53, proportions=0.35),
    "woman-1": Subject(gender=1.0, age=0.66, muscle=0.08, weight=0.06, height=0.33, proportions=0.23),
    "child-1": Subject(gender=0.0, age=0.34, muscle=0.78, weight=0.53, height=0.33, proportions=0.91),
    "man-2": Subject(gender=0.0, age=0.95, muscle=0.09, weight=0.81, height=0.23, proportions=0.80),
    "woman-2": Subject(gender=1.0, age=0.82, muscle=0.19, weight=0.88, height=0.23, proportions=0.24),
    "child-2": Subject(gender=0.0, age=0.30, muscle=0.22, weight=0.39, height=0.07, proportions=0.16),
    "man-3": Subject(gender=0.0, age=0.98, muscle=0.94, weight=0.13, height=0.29, proportions=0.72),
    "woman-3": Subject(gender=1.0, age=0.60, muscle=0.75, weight=0.35, height=0.28, proportions=0.32),
    "child-3": Subject(gender=1.0, age=0.40, muscle=0.11, weight=0.96, height=0.07, proportions=0.18),
    "child-4": Subject(gender=1.0, age=0.33, muscle=0.15, weight=0.37, height=0.17, proportions=0.07),
    "man-4": Subject(gender=0.0, age=0.75, muscle=0.15, weight=0.73, height=0.31, proportions=0.09),
    "woman-4": Subject(gender=1.0, age=0.96, muscle=0.11, weight=0.23, height=0.48, proportions=0.33),
    "child-5": Subject(gender=0.0, age=0.39, muscle=0.11, weight=0.96, height=0.08, proportions=0.31),
    "man-5": Subject(gender=0.0, age=0.69, muscle=0.17, weight=0.09, height=0.18, proportions=0.23),
    "woman-5": Subject(gender=1.0, age=0.98, muscle=0.14, weight=0.67, height=0.53, proportions=0.69),
}
"""The bodies, in the order of the data set.

Training subjects (0 to 9) and test subjects (10 to 14) both hold men, women and children. The values come from an
exchange search over random bodies of usual height for the largest smallest distance between two of the same area.
"""

_CHILDREN = (0.26, 0.48)
_ADULTS = (0.60, 1.0)
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
        candidate = Subject(gender, age, *random.uniform(0.1, 0.95, 4).tolist())
        if np.linalg.norm(taken - astuple(candidate), axis=1).min() >= _CLEARANCE:
            return candidate

"""Twelve shapes on a line: their names, classes, and distances."""

import numpy as np

PLACES = {
    "a0": 0,
    "a1": 1,
    "a2": 2,
    "a9": 9,
    "b4": 4,
    "b5": 5,
    "b6": 6,
    "b12": 12,
    "c3": 3,
    "c20": 20,
    "d30": 30,
    "e7": 7,
}
NAMES, LABELS = list(PLACES), [name[0] for name in PLACES]
X = np.array(list(PLACES.values()), dtype=float)
D = np.abs(X[:, None] - X)

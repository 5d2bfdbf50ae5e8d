"""Twelve shapes on a line: their names, classes, and distances."""

import numpy as np

POSITIONS = {
    "a0": 0, "a1": 1, "a2": 2, "a9": 9, "b4": 4, "b5": 5,
    "b6": 6, "b12": 12, "c3": 3, "c20": 20, "d30": 30, "e7": 7,
}  # fmt: skip
NAMES, LABELS = list(POSITIONS), [name[0] for name in POSITIONS]
X = np.array(list(POSITIONS.values()), dtype=float)
D = np.abs(X[:, None] - X)

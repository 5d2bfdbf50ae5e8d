"""Orders that tell nothing: foreign code gets shapes and galleries shuffled, and what it returns is put in order."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.storage.keys import digest

T = TypeVar("T")


def shuffled(names: Sequence[str]) -> list[str]:
    """Return names in an order that depends on all of them, so that nobody without them can undo it."""
    return random.Random(digest(list(names))).sample(names, len(names))  # noqa: S311


def in_shuffled_order(
    names: Sequence[str], items: Sequence[T], compare: Callable[[Sequence[T]], NDArray[Any]]
) -> NDArray[Any]:
    """Compare all pairs of items in another order, and return the matrix in theirs.

    Parameters
    ----------
    names
        Of the items; they determine the order.
    items
        N of them.
    compare
        Returns the dissimilarities of all pairs, shape (N, N).
    """
    place = {name: number for number, name in enumerate(shuffled(names))}
    order = sorted(range(len(names)), key=lambda number: place[names[number]])
    back = np.argsort(order)
    return compare([items[number] for number in order])[np.ix_(back, back)]

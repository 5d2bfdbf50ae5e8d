"""An order of a gallery that tells foreign code nothing: it follows from what that code is given of each shape."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


def in_shuffled_order(items: Sequence[T], compare: Callable[[Sequence[T]], NDArray[Any]]) -> NDArray[Any]:
    """Compare all pairs of items in another order, and return the matrix in theirs.

    Parameters
    ----------
    items
        Descriptors or signatures of N shapes; the order follows from a few measurements of them, and from no name.
    compare
        Returns the dissimilarities of all pairs, shape (N, N).
    """
    places = [_place(item if isinstance(item, Mapping) else {"": np.asarray(item)}) for item in items]
    order = sorted(range(len(items)), key=places.__getitem__)
    back = np.argsort(order)
    return compare([items[number] for number in order])[np.ix_(back, back)]


def _place(arrays: Mapping[str, NDArray[Any]]) -> tuple[Any, ...]:
    """What places are sorted by: measurements to six digits, then every bit, and chance between copies."""
    measurements = []
    for name in sorted(arrays):
        sizes = np.abs(np.asarray(arrays[name], dtype=np.float64)).ravel()
        ramp = np.linspace(1, 2, sizes.size)
        moments = [f"{value:.6g}" for value in (sizes.mean(), (sizes * ramp).mean())] if sizes.size else []
        measurements += [name, str(np.shape(arrays[name])), *moments]
    digest = hashlib.sha256(" ".join(measurements).encode()).hexdigest()
    return digest, [arrays[name].tobytes() for name in sorted(arrays)], secrets.randbits(64)

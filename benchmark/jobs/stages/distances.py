"""Dissimilarities of all pairs of a gallery: of its forms by a scorer, or of its descriptors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.methods.output_checks import distances_of, real_numbers

if TYPE_CHECKING:
    from benchmark.api.contracts import Descriptor
    from benchmark.api.scoring import Scorer, SignatureArrays

Matrix = NDArray[np.float64]

_HINT = "return the distances of all pairs as a symmetric matrix of finite numbers"


def form_distances(scorer: Scorer, signatures: Sequence[SignatureArrays], draw: int) -> Matrix:
    """Dissimilarities of all pairs of forms under one draw of the scorer, shape (N, N).

    Raises
    ------
    InvalidForm
        If the scorer returns anything but a square matrix of finite real numbers.
    """
    count = len(signatures)
    return real_numbers(f"scorer '{scorer.info.name}'", scorer.compare(signatures, draw), (count, count), _HINT)


def descriptor_distances(method: Descriptor, descriptors: Sequence[Matrix]) -> Matrix:
    """Dissimilarities that a descriptor finds between all pairs of shapes, shape (N, N).

    Raises
    ------
    InvalidForm
        If the descriptor returns anything but a square matrix of finite real numbers.
    """
    return distances_of(method, descriptors)

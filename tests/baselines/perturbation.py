"""Rounding errors made to order: what another processor, another BLAS, or another order of sums would do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg

from baselines._kernels import arap, interpolation
from benchmark.api.contracts import Mesh
from benchmark.geometry import geodesics

#: Vertices move by up to this share of the size of the shape.
MOVE = 1e-13
#: Results of linear algebra and distances change by up to this share of the largest number: a few last places.
NOISE = 1e-15


def moved(mesh: Mesh, seed: int) -> Mesh:
    """The mesh with every coordinate moved at random."""
    noise = np.random.default_rng(seed).uniform(-MOVE, MOVE, mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + noise * np.ptp(mesh.vertices, axis=0).max())


@contextmanager
def other_rounding(seed: int) -> Iterator[None]:
    """Inside, eigenvectors have other signs, and solvers and geodesics make other rounding errors."""
    random = np.random.default_rng(seed)

    def noisy(array: np.ndarray) -> np.ndarray:
        return array + NOISE * np.abs(array).max() * random.uniform(-1, 1, array.shape)

    def eigen(solve: Any) -> Any:
        def solved(*args: Any, **options: Any) -> Any:
            result = solve(*args, **options)
            if isinstance(result, np.ndarray):
                return noisy(result)
            values, vectors = result
            return noisy(values), noisy(vectors) * random.choice([-1.0, 1.0], vectors.shape[1])

        return solved

    def plain(solve: Any) -> Any:
        def solved(*args: Any, **options: Any) -> Any:
            result = solve(*args, **options)
            return noisy(result) if isinstance(result, np.ndarray) else tuple(map(noisy, result))

        return solved

    class Factors:
        def __init__(self, *args: Any, **options: Any) -> None:
            self._factors = scipy.sparse.linalg.splu(*args, **options)

        def solve(self, right: np.ndarray) -> np.ndarray:
            return noisy(self._factors.solve(right))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.linalg, "eigh", eigen(np.linalg.eigh))
        patch.setattr(np.linalg, "qr", plain(np.linalg.qr))
        patch.setattr(np.linalg, "solve", plain(np.linalg.solve))
        patch.setattr(np.linalg, "svd", plain(np.linalg.svd))
        patch.setattr(scipy.sparse.linalg, "eigsh", eigen(scipy.sparse.linalg.eigsh))
        patch.setattr(geodesics, "shortest_paths", plain(geodesics.shortest_paths))
        for module in (arap, interpolation):
            patch.setattr(module, "splu", Factors)
        yield

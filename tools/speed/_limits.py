"""The least time that a method can take here: bytes it moves and operations it does, over rates that are measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from tools.speed._timing import least_seconds

REPEATS = 9
_LARGE, _SMALL, _COLUMNS = 2**23, 2000, 200


@dataclass(frozen=True)
class Rates:
    """Rates that one core of this machine reaches at best.

    Parameters
    ----------
    bytes
        Read or written, of arrays beyond the cache.
    sums, singles
        Operations of a product of a matrix in the cache and a vector, in double and in single precision.
    roots
        Square roots with a quotient each.
    looks
        Values found by their index, in a table that fits the cache.
    """

    bytes: float
    sums: float
    singles: float
    roots: float
    looks: float


@cache
def rates() -> Rates:
    """Measure the rates, each by the least time of some runs."""
    source, target = np.ones(_LARGE), np.ones(_LARGE)
    basis, vector = np.ones((_SMALL, _COLUMNS)), np.ones(_COLUMNS)
    values, places = np.linspace(1, 2, _SMALL), np.random.default_rng(0).integers(0, _SMALL, _LARGE // 8)

    def roots() -> None:
        for _ in range(1000):
            np.divide(1.0, np.sqrt(values, out=target[:_SMALL]), out=target[:_SMALL])

    def operations(precision: type) -> float:
        matrix, column = basis.astype(precision), vector.astype(precision)

        def sums() -> None:
            for _ in range(100):
                matrix @ column

        return 100 * 2 * basis.size / least_seconds(sums, REPEATS)

    return Rates(
        bytes=2 * source.nbytes / least_seconds(partial(np.copyto, target, source), REPEATS),
        sums=operations(np.float64),
        singles=operations(np.float32),
        roots=1000 * _SMALL / least_seconds(roots, REPEATS),
        looks=places.size / least_seconds(lambda: values.take(places), REPEATS),
    )


@dataclass(frozen=True)
class Limit:
    """Least seconds of a method, with what they are made of in words.

    Parameters
    ----------
    parts
        Seconds by the words that derive them.
    """

    parts: dict[str, float]

    @classmethod
    def of(
        cls,
        moved: float = 0,
        roots: float = 0,
        looks: float = 0,
        sums: float = 0,
        singles: float = 0,
        **measured: float,
    ) -> Limit:
        """Return the limit of so many bytes and operations beside parts that were measured in seconds."""
        found, best = {name.replace("_", " "): seconds for name, seconds in measured.items()}, rates()
        counted = (
            (moved, best.bytes, f"{moved / 1e9:.2f} GB at {best.bytes / 1e9:.1f} GB/s"),
            (roots, best.roots, f"{roots / 1e6:.0f} million roots and quotients at {best.roots / 1e9:.2f} a ns"),
            (looks, best.looks, f"{looks / 1e6:.0f} million values by index at {best.looks / 1e9:.2f} a ns"),
            (sums, best.sums, f"{sums / 1e9:.2f} Gflop at {best.sums / 1e9:.1f} Gflop/s"),
            (
                singles,
                best.singles,
                f"{singles / 1e9:.2f} Gflop in single precision at {best.singles / 1e9:.1f} Gflop/s",
            ),
        )
        return cls(found | {words: amount / rate for amount, rate, words in counted if amount})

    @property
    def seconds(self) -> float:
        """Sum of the parts."""
        return sum(self.parts.values())

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {1e3 * seconds:.3g} ms" for name, seconds in self.parts.items())
        return f"limit {1e3 * self.seconds:.3g} ms: {parts}"

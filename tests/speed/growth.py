"""Time against the number of vertices: ``python -m tests.speed.growth``; writes ``results/growth.json`` and a figure.

Processor time of one thread, so that other work on the machine matters little.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
import signal  # noqa: E402
from collections.abc import Callable, Iterator, Mapping, Sequence  # noqa: E402
from contextlib import contextmanager  # noqa: E402
from functools import partial  # noqa: E402
from typing import Any  # noqa: E402

import matplotlib as mpl  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from benchmark.contracts import Mesh, Method, Shape  # noqa: E402
from benchmark.datasets.humans import Humans  # noqa: E402
from benchmark.errors import UnsupportedShape  # noqa: E402
from benchmark.geometry import geodesics  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.registry import BUILT_IN, MethodSpec  # noqa: E402
from tests.speed._document import FIGURE, GROWTH, machine, write_document  # noqa: E402
from tests.speed._timing import processor_seconds  # noqa: E402

mpl.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

SIZES = (500, 1000, 2000, 4000, 8000)
LIMIT = 60.0
REPEATS = 3
LONG_RUN = 5.0
GEODESICS = "geodesics, all pairs"
LEAST_LABEL_STEP = 1.35
FAINTEST = 1e-4


class TooSlow(Exception):
    """The limit has passed."""


class Memory:
    """Keeps the artefacts of one mesh for several shapes, and knows whether all geodesics were asked for."""

    def __init__(self) -> None:
        self.kept: dict[str, Mapping[str, NDArray[Any]]] = {}

    def get_or_compute(
        self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Mapping[str, NDArray[Any]]]
    ) -> Mapping[str, NDArray[Any]]:
        """Compute a stage once."""
        name = f"{stage} {sorted(parameters.items())}"
        if name not in self.kept:
            self.kept[name] = compute()
        return self.kept[name]


class CountingShape(Shape):
    """Counts how often a few rows of geodesics are asked for."""

    rows_asked = 0

    def geodesics_from(self, *arguments: Any, **options: Any) -> Any:
        """Count and pass on."""
        self.rows_asked += 1
        return super().geodesics_from(*arguments, **options)


def main() -> None:
    """Measure, draw, and write the tables."""
    humans = Humans()
    body = humans.load(humans.entries[-1])
    rows: dict[str, dict[str, Any]] = {}
    # The first, unrecorded round on the smallest mesh compiles.
    for size in (SIZES[0], *SIZES):
        if rows and all(not each["seconds"] for each in rows.values()):
            for each in rows.values():
                each["seconds"].clear()
        rows = measure_size(prepare(body, size).mesh, rows)
    write(list(rows.values()))

"""Compile all kernels before the first run: ``python -m benchmark.kernels``.

Kernels are compiled on first use and cached beside the code. The workers of a run start together, so each would compile
all of them. Here one process compiles them by the steps of a run, so that they fit the types of its arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from benchmark.errors import BenchmarkError
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.api.contracts import Shape
    from benchmark.registry import Component

#: Seconds of the steps that compile most, on one processor; others take about ``_OTHERS``.
_SECONDS = {"shapes": 1.0, "classic-mds": 3.0, "skeleton": 5.0, "humans-scanlike": 3.0, "scorer": 13.0}
_OTHERS = 0.3

Step = tuple[str, Callable[[], object]]


def steps() -> Iterator[Step]:
    """Yield the steps of a run with their names, on small shapes."""
    from benchmark.datasets.catalogue import CATALOGUE
    from benchmark.registry import by_name

    shapes: dict[str, Shape] = {}
    yield "shapes", partial(prepare, shapes)
    for method in by_name("method").values():
        yield method.name, partial(apply, method, shapes)
    for name, source in CATALOGUE.items():
        if not source.folder:
            yield name, partial(generate, name)
    yield "scorer", compare


def prepare(shapes: dict[str, Shape]) -> None:
    """Prepare a figure, complete and as a single view."""
    from benchmark.check.shapes import figure
    from benchmark.geometry.camera import FRONT
    from benchmark.pipeline.preparation import fit_frame, prepare_mesh, prepare_view
    from benchmark.pipeline.stages import shape_of

    source = figure()
    prepared = {"mesh": prepare_mesh(source), "view": prepare_view(source, FRONT, fit_frame(source, FRONT))}
    shapes |= {input_: shape_of(arrays, "figure") for input_, arrays in prepared.items()}


def apply(component: Component, shapes: Mapping[str, Shape]) -> None:
    """Apply a method, with its default model if it learns."""
    from benchmark.protocols.models import with_model

    method = with_model(component)
    for input_ in component.info.inputs:
        with suppress(BenchmarkError):
            (method.describe if component.describes else method.canonicalise)(shapes[input_])


def generate(name: str) -> None:
    """Generate the second shape of a data set; the pose of the first does not bend joints."""
    from benchmark.datasets.catalogue import open_dataset

    dataset = open_dataset(name, None)
    dataset.load(dataset.shapes[1])


def compare() -> None:
    """Compare a figure with a bent copy."""
    from benchmark.check.shapes import BENDS, figure
    from benchmark.registry import select_one

    scorer = select_one("cm-bof", kind="scorer").create()
    scorer.compare([scorer.signature(figure(bend)) for bend in BENDS[:2]], 0)


def main() -> None:
    """Compile all kernels."""
    pin_threads()
    from benchmark.cli.progress import counting

    drop_stale_kernels()
    start = time.monotonic()
    for _, compile_step in counting("compiling kernels", steps(), lambda step: _SECONDS.get(step[0], _OTHERS)):
        with suppress(BenchmarkError):  # missing packages and models are left for the run to report
            compile_step()
    say(f"kernels compiled after {time.monotonic() - start:.0f} s", err=True)


if __name__ == "__main__":
    main()

"""Compile all kernels before the first run: ``python -m benchmark.kernel_cache``.

Kernels are compiled on first use and cached beside the code. The workers of a run start together,
so each would compile all of them. Here one process compiles them by the steps of a run, so that
they fit the types of its arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial

from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import BenchmarkError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.text import say


def steps() -> Iterator[Callable[[], object]]:
    """Yield the steps of a run: methods on a small figure, bodies in a pose that bends, a scorer."""
    from benchmark.check.shapes import BENDS, figure
    from benchmark.datasets.catalogue import CATALOGUE, open_dataset
    from benchmark.geometry.camera import FRONT
    from benchmark.pipeline.forms import shape_of
    from benchmark.pipeline.surfaces import prepare_mesh
    from benchmark.pipeline.views import fit_frame, prepare_view
    from benchmark.protocols.models import with_model
    from benchmark.registry import Component, by_name, select_one

    source = figure()
    prepared = {
        "mesh": prepare_mesh(source),
        "view": prepare_view(source, FRONT, fit_frame(source, FRONT)),
    }
    shapes = {input_: shape_of(arrays, "figure") for input_, arrays in prepared.items()}

    def apply(component: Component) -> None:
        method = with_model(component)
        for input_ in component.info.inputs:
            with suppress(BenchmarkError):
                (method.describe if component.describes else method.canonicalise)(shapes[input_])

    for component in by_name("method").values():
        yield partial(apply, component)
    for name in [name for name, known in CATALOGUE.items() if not known.folder]:
        dataset = open_dataset(name, None)
        yield partial(dataset.load, dataset.shapes[1])
    scorer = select_one(DEFAULT_SCORER, kind="scorer").create()
    yield lambda: scorer.compare([scorer.signature(figure(bend)) for bend in BENDS[:2]], 0)


def main() -> None:
    """Compile all kernels."""
    pin_threads()
    from benchmark.cli.progress import counting

    drop_stale_kernels()
    start = time.monotonic()
    for compile_step in counting("compiling kernels", steps()):
        with suppress(BenchmarkError):  # missing packages and models are left for the run to report
            compile_step()
    say(f"kernels compiled after {time.monotonic() - start:.0f} s", err=True)


if __name__ == "__main__":
    main()

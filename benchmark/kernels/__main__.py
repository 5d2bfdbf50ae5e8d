"""Compile all kernels before the first run: ``python -m benchmark.kernels``.

Kernels are compiled on first use and cached beside the code. The workers of a run start together, so each would compile
all of them. Here one process compiles them by the steps of a run, so that they fit the types of its arrays.
"""

from __future__ import annotations

import time
from contextlib import suppress

from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.text import say


def compile_bodies() -> None:
    """Generate one shape of each kind in the second pose; the first pose does not bend joints."""
    from benchmark.datasets.catalogue import CATALOGUE, open_dataset

    for name, source in CATALOGUE.items():
        if not source.folder:
            dataset = open_dataset(name, None)
            dataset.load(dataset.shapes[1])


def compile_scorer() -> None:
    """Compare a figure with a bent copy."""
    from benchmark.check.shapes import BENDS, figure
    from benchmark.registry import select_one

    scorer = select_one("cm-bof", kind="scorer").create()
    scorer.compare([scorer.signature(figure(bend)) for bend in BENDS[:2]], 0)


def compile_methods() -> None:
    """Apply each method, with its default model if it learns, to a small figure, complete and as a single view."""
    from benchmark.check.shapes import figure
    from benchmark.geometry.camera import FRONT
    from benchmark.pipeline.preparation import fit_frame, prepare_mesh, prepare_view
    from benchmark.pipeline.stages import shape_of
    from benchmark.protocols.models import with_model
    from benchmark.registry import by_name

    source = figure()
    prepared = {"mesh": prepare_mesh(source), "view": prepare_view(source, FRONT, fit_frame(source, FRONT))}
    shapes = {input_: shape_of(arrays, "figure") for input_, arrays in prepared.items()}
    for row in by_name("method").values():
        with suppress(ConfigurationError):  # missing packages and models are left for the run to report
            method = with_model(row)
            apply = method.describe if row.describes else method.canonicalise
            for input_ in row.info.inputs:
                with suppress(ShapeError):
                    apply(shapes[input_])


PARTS = {"methods": compile_methods, "bodies": compile_bodies, "scorer": compile_scorer}


def main() -> None:
    """Compile all parts, one after the other."""
    pin_threads()
    drop_stale_kernels()
    for name, compile_part in PARTS.items():
        start = time.monotonic()
        with suppress(BenchmarkError):  # missing packages are left for the run to report
            compile_part()
        say(f"{name} done after {time.monotonic() - start:.0f} s", err=True)


if __name__ == "__main__":
    main()

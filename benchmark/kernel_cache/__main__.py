"""Compile all kernels before the first run: ``python -m benchmark.kernel_cache``.

With ``--quick``, it compiles those of a quick run.

Kernels are compiled on first use and cached beside the code. The workers of a run start together,
so each would compile all of them. Here one process compiles them by the steps of a run, so that
they fit the types of its arrays.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import BenchmarkError
from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.text import say

if TYPE_CHECKING:  # numerical libraries are imported once threads are pinned
    from benchmark.api.contracts import Shape
    from benchmark.registry import Component


class KernelUse(NamedTuple):
    """A step of a run that uses kernels, and what it is called."""

    name: str
    compute: Callable[[], object]


def steps(*, quick: bool = False) -> list[KernelUse]:
    """Return work that makes all kernels compile: methods, generated data sets and the scorer.

    Parameters
    ----------
    quick
        Whether only the kernels of a quick run are meant: no network has one, and no scan is
        simulated.
    """
    from benchmark.datasets.catalogue import CATALOGUE
    from benchmark.protocols.galleries import QUICK_ROWS
    from benchmark.registry import by_name

    uses: list[KernelUse] = []
    for name, method in by_name("method").items():
        if not quick or (name in QUICK_ROWS and not method.learns):
            uses.append(KernelUse(name, partial(_apply, method)))
    for name, known_set in CATALOGUE.items():
        if not (quick or known_set.folder):
            uses.append(KernelUse(name, partial(_load_bent_shape, name)))
    return [*uses, KernelUse(DEFAULT_SCORER, _compare_figures)]


@cache
def _figure_as_input() -> dict[str, Shape]:
    """Return a small figure as methods get it: as a surface (``"mesh"``) and as a depth view."""
    from benchmark.check.shapes import figure
    from benchmark.geometry.camera import FRONT
    from benchmark.pipeline.forms import shape_of
    from benchmark.pipeline.surfaces import prepare_mesh
    from benchmark.pipeline.views import fit_frame, prepare_view

    source = figure()
    half_width = fit_frame(source, FRONT)
    return {
        "mesh": shape_of(prepare_mesh(source), "figure"),
        "view": shape_of(prepare_view(source, FRONT, half_width), "figure"),
    }


def _load_bent_shape(name: str) -> None:
    """Load the second shape of a generated set: it is bent, so that its pose is computed, too."""
    from benchmark.datasets.catalogue import open_dataset

    dataset = open_dataset(name, None)
    dataset.load(dataset.shapes[1])


def _apply(component: Component) -> None:
    """Apply a method or descriptor to the inputs that it takes."""
    from benchmark.protocols.models import with_model

    method = with_model(component)
    compute = method.describe if component.describes else method.canonicalise
    for input_ in component.info.inputs:
        with suppress(BenchmarkError):  # a method may refuse the figure
            compute(_figure_as_input()[input_])


def _compare_figures() -> None:
    """Compare a figure in two poses by the scorer of the tables."""
    from benchmark.check.shapes import BENDS, figure
    from benchmark.registry import select_one

    scorer = select_one(DEFAULT_SCORER, kind="scorer").create()
    signatures = [scorer.signature(figure(bend)) for bend in BENDS[:2]]
    scorer.compare(signatures, 0)


def main(*, quick: bool = False) -> None:
    """Compile all kernels, or those of a quick run."""
    pin_threads()
    from benchmark.cli.progress import counting

    drop_stale_kernels()
    start = time.monotonic()
    for step in counting("compiling kernels", steps(quick=quick), name=lambda step: step.name):
        with suppress(BenchmarkError):  # missing packages and models are left for the run to report
            step.compute()
    say(f"kernels compiled after {time.monotonic() - start:.0f} s", err=True)


if __name__ == "__main__":
    main(quick="--quick" in sys.argv[1:])

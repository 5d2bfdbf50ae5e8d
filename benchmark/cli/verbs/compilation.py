"""The verb ``compile``: what a machine does once, done before the first run by a process for each part of it.

Kernels are compiled on their first use and kept beside the code. Workers of a run begin with the same ones, and each
would compile them all for itself. Here every part is compiled by one process, and by the same steps as in a run, so
that the kernels are those for the arrays that a run passes.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from benchmark.errors import BenchmarkError, ShapeError
from benchmark.text import say

if TYPE_CHECKING:
    from collections.abc import Iterable

    from benchmark.api.contracts import Input
    from benchmark.arrays import Arrays
    from benchmark.execution.processes.channel import Facts
    from benchmark.execution.processes.process import Requester
    from benchmark.plugins.registry import MethodSpec


@click.command("compile")
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; all cores by default.")
def compile_(jobs: int | None) -> None:
    """Compile the kernels and build the body model in advance; otherwise the first run does."""
    from benchmark.threads import available_cores

    sys.exit(0 if compile_parts(jobs or available_cores()) else 1)


def compile_parts(jobs: int) -> bool:
    """Compile all parts by several processes, telling on stderr which part is done.

    Parameters
    ----------
    jobs
        Processes at a time.

    Returns
    -------
    bool
        Whether all went well; what went wrong has been said.
    """
    from benchmark.execution.processes.channel import wait_for
    from benchmark.execution.processes.process import INTERVAL, ForeignError, Process, ProcessEnded
    from benchmark.kernels import drop_stale_kernels
    from benchmark.source_code import ROOT

    start = time.monotonic()
    drop_stale_kernels(ROOT)
    waiting, running, ok = list(PARTS), dict[str, Process](), True
    say(f"compiling, once for this checkout: {', '.join(PARTS)}", err=True)
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                name = waiting.pop(0)
                running[name] = Process(_compile)
                running[name].send({"part": name})
            wait_for(running.values(), INTERVAL)
            for name, process in list(running.items()):
                try:
                    if (message := process.receive(0.0)) is None:
                        continue
                    process.result(message)
                    end = "done"
                except (BenchmarkError, ForeignError, MemoryError, ProcessEnded) as error:
                    ok, end = False, f"ended with {error}"
                process.end()
                del running[name]
                say(f"{name} {end} after {time.monotonic() - start:.0f} s", err=True)
    finally:
        for process in running.values():
            process.end()
    return ok


def _compile(facts: Facts, arrays: Arrays, requester: Requester) -> tuple[Facts, Arrays]:
    """Compile one part, in its process; what this machine lacks is for the run to say, if it needs it."""
    with suppress(BenchmarkError):
        PARTS[facts["part"]]()
    return {}, {}


def compile_bodies() -> None:
    """Make one shape of each generator, in the second pose, which bends what the first one leaves at rest."""
    from benchmark.datasets.catalogue import CATALOGUE, open_dataset

    for name, source in CATALOGUE.items():
        if not source.folder:
            dataset = open_dataset(name, None)
            dataset.load(dataset.entries[1])


def compile_scorer() -> None:
    """Rank the figure against its bent self."""
    from benchmark.plugins.conformance.shapes import BENDS, figure
    from benchmark.plugins.output_checks import form_distances, signature_of
    from benchmark.plugins.scorers import ScorerSpec

    scorer = ScorerSpec().create()
    form_distances(scorer, [signature_of(scorer, figure(bend)) for bend in BENDS[:2]], draw=0)


def compile_methods() -> None:
    """Treat a small figure, complete and as a camera sees it, by every method that does not learn."""
    from benchmark.geometry.io import write_mesh
    from benchmark.plugins.conformance.shapes import figure
    from benchmark.plugins.registry import methods
    from benchmark.protocols.tables import INPUTS, VARIANTS

    specs = [spec for spec in methods().values() if not spec.learns]
    rows = [row for spec in specs for row in (spec, *map(spec.with_parameters, VARIANTS.get(spec.base_name, ())))]
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as name:
        write_mesh(Path(name, "figure0.off"), figure())
        for input_ in INPUTS:
            _treat(Path(name), input_, [row for row in rows if input_ in row.info.inputs])


def _treat(folder: Path, input_: Input, rows: Iterable[MethodSpec]) -> None:
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.pipeline.method_run import MethodRun
    from benchmark.pipeline.preparation import Preparation
    from benchmark.pipeline.storage.store import Store

    store = Store.open(folder / "results")
    dataset = open_dataset(str(folder), None)
    preparation = Preparation(dataset, input_, store)
    for row in rows:
        with suppress(ShapeError):
            MethodRun(preparation, store, row).answer(dataset.entries[0])


PARTS: dict[str, Callable[[], None]] = {
    "methods": compile_methods,
    "bodies": compile_bodies,
    "scorer": compile_scorer,
}

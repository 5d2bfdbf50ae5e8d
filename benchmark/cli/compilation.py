"""``compile``: compile all kernels before the first run.

Kernels are compiled on first use and cached beside the code. The workers of a run start with the same kernels, so each
would compile all of them. Here one process compiles each part, by the steps of a run, so that the kernels fit the types
of its arrays.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from benchmark.api.contracts import Shape
from benchmark.arrays import Arrays
from benchmark.cli.options import Compile
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, ShapeError
from benchmark.execution.processes.channel import Facts, wait_for
from benchmark.execution.processes.process import INTERVAL, ForeignError, Process, ProcessEnded, Tell
from benchmark.geometry.io import write_mesh
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import available_cores
from benchmark.pipeline.method_run import MethodRun, Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.conformance.cases import BENDS, figure
from benchmark.plugins.output_checks import form_distances, signature_of
from benchmark.plugins.registry import VARIANTS, methods
from benchmark.plugins.scorers import ScorerSpec
from benchmark.protocols.models import with_model
from benchmark.protocols.tables import INPUTS
from benchmark.source_code import ROOT
from benchmark.text import say


def compile_(options: Compile) -> bool:
    """Compile each part in a separate process."""
    start = time.monotonic()
    drop_stale_kernels(ROOT)
    waiting, running, ok = list(PARTS), dict[str, Process](), True
    say(f"compiling, once for this checkout: {', '.join(PARTS)}", err=True)
    try:
        while waiting or running:
            while waiting and len(running) < (options.processes or available_cores()):
                name = waiting.pop(0)
                running[name] = Process(_compile)
                running[name].send({"part": name})
            wait_for(running.values(), INTERVAL)
            for name, process in list(running.items()):
                try:
                    if process.receive(0.0) is None:
                        continue
                    end = "done"
                except (BenchmarkError, ForeignError, MemoryError, ProcessEnded) as error:
                    ok, end = False, f"ended with {error}"
                running.pop(name).end()
                say(f"{name} {end} after {time.monotonic() - start:.0f} s", err=True)
    finally:
        for process in running.values():
            process.end()
    return ok


def _compile(facts: Facts, arrays: Arrays, tell: Tell) -> tuple[Facts, Arrays]:
    """Compile one part in a child process; missing packages are left for the run to report."""
    with suppress(BenchmarkError):
        PARTS[facts["part"]]()
    return {}, {}


def _compile_bodies() -> None:
    """Generate one shape of each kind in the second pose; the first pose does not bend joints."""
    for name, source in CATALOGUE.items():
        if not source.folder:
            dataset = open_dataset(name, None)
            dataset.load(dataset.entries[1])


def _compile_scorer() -> None:
    """Compare a figure with a bent copy."""
    scorer = ScorerSpec().create()
    form_distances(scorer, [signature_of(scorer, figure(bend)) for bend in BENDS[:2]], draw=0)


def _compile_methods() -> None:
    """Apply each method that does not learn to a small figure, complete and as a single view."""
    specs = [spec for spec in methods().values() if not spec.learns]
    rows = [row for spec in specs for row in (spec, *map(spec.with_parameters, VARIANTS.get(spec.base_name, ())))]
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        write_mesh(Path(folder, "figure0.off"), figure())
        store, dataset = Store.open(Path(folder, "results")), open_dataset(folder, None)
        for input_ in INPUTS:
            preparation = Preparation(dataset, input_, store)
            for row in rows:
                if input_ in row.info.inputs:
                    with suppress(ShapeError):
                        MethodRun(preparation, store, row).answer(dataset.entries[0])


def _compile_learners() -> None:
    """Apply the default model of a learner of each module to a small figure."""
    of_module = {spec.module: spec for spec in methods().values() if spec.learns}
    for spec in of_module.values():
        with suppress(ConfigurationError, ShapeError):
            with_model(spec).canonicalise(Shape(identifier="figure", mesh=figure()))


PARTS: dict[str, Callable[[], None]] = {
    "methods": _compile_methods,
    "learners": _compile_learners,
    "bodies": _compile_bodies,
    "scorer": _compile_scorer,
}

"""Compile kernels once, before the workers of a run want them.

Kernels are compiled on first use and cached beside the code. The workers of a run start together,
so each would compile all of them. Here one process compiles them by the steps of a run, so that
they fit the types of its arrays.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from benchmark.code_digest import sources_of
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.changes import split_changes
from benchmark.errors import BenchmarkError
from benchmark.kernel_cache import drop_stale_kernels, is_marked, mark
from benchmark.pipeline.prepared import PREPARING_MODULES
from benchmark.protocols.galleries import QUICK_ROWS
from benchmark.registry import by_name
from benchmark.registry.modules import environment

if TYPE_CHECKING:
    from benchmark.api.contracts import Input, Shape
    from benchmark.commands.plan import Plan
    from benchmark.registry import Component
    from benchmark.runs.planning import Planned

#: The program that compiles kernels; a file in the current folder replaces no module of Python.
_PROGRAM = """
import sys
sys.path.append(sys.path.pop(0))
from benchmark.kernel_cache.__main__ import main
main(sys.argv[1:])
"""


class KernelUse(NamedTuple):
    """A step of a run that uses kernels.

    Parameters
    ----------
    name
        What it is called.
    target
        The code that it runs.
    compute
        Runs it on something small.
    """

    name: str
    target: str
    compute: Callable[[], object]

    @property
    def is_compiled(self) -> bool:
        """Whether its kernels were compiled, and none of their code has changed since."""
        return is_marked(self.name, self.source)

    @property
    def has_kernels(self) -> bool:
        """Whether there are kernels in its code."""
        sources = sources_of(self.target)
        return any("njit" in source.read_text(encoding="utf-8") for source in sources)

    @property
    def source(self) -> Path:
        """The source file of its code, which imports others."""
        return sources_of(self.target)[0]

    def compile(self) -> None:
        """Compile its kernels; what a package or a model is missing for, a run will report."""
        with suppress(BenchmarkError):
            self.compute()
        mark(self.name, self.source)


def kernel_uses(names: Collection[str] = (), *, quick: bool = False) -> list[KernelUse]:
    """Return the parts of the suite that use compiled functions (kernels), each with a small task.

    The tasks prepare a shape, apply a method, load a generated shape, or score. To do them compiles
    all kernels. Networks have no kernels.

    Parameters
    ----------
    names
        Names of methods, data sets and scorers, and of preparation; empty for all.
    quick
        Whether to leave out what a quick run does not use: most methods, and generated data sets.
    """

    def is_meant(name: str) -> bool:
        """Return whether a step is meant, by its name."""
        return not names or name in names

    uses: list[KernelUse] = []
    for input_, module in PREPARING_MODULES.items():
        uses.append(KernelUse(_preparation(input_), module, partial(_figure, input_)))
    for name, method in by_name("method").items():
        is_of_run = name in QUICK_ROWS or not quick
        if is_meant(name) and is_of_run and not method.learns:  # the last test imports the method
            uses.append(KernelUse(name, method.target, partial(_apply, method)))
    for name, known_set in CATALOGUE.items():
        if is_meant(name) and not (quick or known_set.folder):
            uses.append(KernelUse(name, _maker(name), partial(_load_bent_shape, name)))
    for name, scorer in by_name("scorer").items():
        uses.append(KernelUse(name, scorer.target, partial(_score, scorer)))
    return [use for use in uses if is_meant(use.name) and use.has_kernels]


def uses_of_jobs(jobs: Iterable[Planned]) -> set[str]:
    """Return the names of the steps of some jobs, as :func:`kernel_uses` calls them."""
    names: set[str] = set()
    for job in jobs:
        components = job.job.method, job.job.scorer
        names.update(component.base_name for component in components if component.of_suite)
        for side in job.sides:
            base, _ = split_changes(side.source.name)
            names |= {base, _preparation(side.source.input)}
    return names


def compile_kernels_of(plan: Plan) -> None:
    """Compile the kernels of the jobs of a plan that were not compiled yet, in one process.

    If that fails, the workers compile them.
    """
    names = uses_of_jobs(job for job in plan.jobs if job.is_pending)
    if not names:
        return
    drop_stale_kernels()
    missing = [use.name for use in kernel_uses(names) if not use.is_compiled]
    if missing:
        command = [sys.executable, "-c", _PROGRAM, *missing]
        subprocess.run(command, env=environment(), stdin=subprocess.DEVNULL, check=False)


# What a run does, on something small
# ------------------------------------------------------------------------------------------------


def _preparation(input_: Input) -> str:
    """Return what the preparation of an input is called."""
    return f"preparation of {input_}"


@cache
def _figure(input_: Input) -> Shape:
    """Return a small figure as methods get it, as a surface or as a depth view."""
    from benchmark.check.shapes import figure
    from benchmark.geometry.camera import FRONT
    from benchmark.pipeline.forms import shape_of
    from benchmark.pipeline.surfaces import prepare_mesh
    from benchmark.pipeline.views import fit_frame, prepare_view

    source = figure()
    if input_ == "mesh":
        return shape_of(prepare_mesh(source), "figure")
    half_width = fit_frame(source, FRONT)
    return shape_of(prepare_view(source, FRONT, half_width), "figure")


def _maker(name: str) -> str:
    """Return the module that makes the meshes of a generated set, the last one if several do."""
    dataset = open_dataset(name)
    return dataset.code(dataset.shapes[0])[-1]


def _load_bent_shape(name: str) -> None:
    """Load the second shape of a generated set: it is bent, so that its pose is computed, too."""
    dataset = open_dataset(name)
    dataset.load(dataset.shapes[1])


def _apply(component: Component) -> None:
    """Apply a method or descriptor to the inputs that it takes."""
    method = component.create()
    compute = method.describe if component.describes else method.canonicalise
    for input_ in component.info.inputs:
        with suppress(BenchmarkError):  # a method may refuse the figure
            compute(_figure(input_))


def _score(component: Component) -> None:
    """Compare a figure in two poses."""
    from benchmark.check.shapes import BENDS, figure

    scorer = component.create()
    signatures = [scorer.signature(figure(bend)) for bend in BENDS[:2]]
    scorer.compare(signatures, 0)

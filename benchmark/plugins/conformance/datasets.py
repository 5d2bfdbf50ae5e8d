"""The checks of a data set of a plugin file, each a function that returns praise, or raises what is wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from benchmark.datasets import checking
from benchmark.datasets.base import Entry, check_retrievable
from benchmark.datasets.own import OwnDataset, open_own
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.calls import BrokenCall, Guard, call_apart
from benchmark.geometry.depth import common_half_width, depth_surface, fit_half_width
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.plugins.conformance.cases import Failed, Warned

__all__ = ["OF_DATA_SETS", "DatasetCase", "DatasetCheck"]

#: Anomalies on one line.
_MOST_ANOMALIES = 3


@dataclass
class DatasetCase:
    """A data set under test; ``source`` is what :func:`benchmark.datasets.own.open_own` takes."""

    source: str

    @cached_property
    def dataset(self) -> OwnDataset:
        """The data set."""
        return open_own(self.source)

    @property
    def first_of_each(self) -> list[Entry]:
        """The first shape of each class."""
        return list({entry.subject: entry for entry in reversed(self.dataset.entries)}.values())[::-1]


DatasetCheck = Callable[[DatasetCase], str]


def _check_entries(case: DatasetCase) -> str:
    dataset = case.dataset
    check_retrievable(dataset)
    if open_own(case.source).entries != dataset.entries:
        raise Failed("'entries' lists other shapes when it is asked again; always list the same ones in one order")
    classes = {entry.subject for entry in dataset.entries}
    return f"{len(dataset.entries)} shapes, {len(classes)} classes, always the same"


def _check_meshes(case: DatasetCase) -> str:
    report = checking.check(case.dataset)
    anomalies = [str(anomaly) for anomaly in report.anomalies]
    further = f" and {len(anomalies) - _MOST_ANOMALIES} more" if len(anomalies) > _MOST_ANOMALIES else ""
    problem = " | ".join(anomalies[:_MOST_ANOMALIES]) + further
    if not report.usable:
        raise Failed(problem)
    if anomalies:
        raise Warned(problem)
    return "every mesh can be made and is sound"


def _check_repeatable(case: DatasetCase) -> str:
    dataset, again = case.dataset, open_own(case.source)
    before = {entry.identifier: _digest(dataset.load(entry)) for entry in case.first_of_each}
    for entry in reversed(case.first_of_each):
        if _digest(again.load(entry)) != before[entry.identifier]:
            raise Failed(f"the mesh of '{entry.identifier}' changes from time to time; keep nothing between shapes")
    return "the same whatever was loaded before"


def _check_fresh_process(case: DatasetCase) -> str:
    try:
        description = call_apart(_described, case.source, guard=Guard("the data set", "find the crash"))
    except BrokenCall as error:
        raise Failed(str(error)) from error
    if description != _described(case.source):
        raise Failed("another process finds other shapes; do not depend on hashes, globals, the clock or the folder")
    return "another process finds the same shapes, recipes, cameras and meshes"


def _described(source: str) -> list[list[str]]:
    """Return what determines the set, in plain values; the mesh of the first shape of each class."""
    case = DatasetCase(source)
    listed = [
        [entry.identifier, entry.subject, entry.pose, case.dataset.recipe(entry), repr(case.dataset.camera(entry))]
        for entry in case.dataset.entries
    ]
    return [*listed, [_digest(case.dataset.load(entry)) for entry in case.first_of_each]]


def _check_inputs(case: DatasetCase) -> str:
    dataset, problems = case.dataset, []
    loaded = [(entry, dataset.load(entry)) for entry in case.first_of_each]
    widths = [fit_half_width([mesh], dataset.camera(entry)) for entry, mesh in loaded]
    half_width = dataset.half_width or common_half_width(widths)
    for entry, mesh in loaded:
        try:
            prepare(mesh)
            depth_surface(mesh, dataset.camera(entry), half_width)
        except BenchmarkError as error:
            problems.append(f"{entry.identifier}: {error}")
    if problems:
        raise Failed("; ".join(problems))
    return "a shape of each class can be prepared, and is seen by its camera"


def _digest(mesh: Mesh) -> str:
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()


OF_DATA_SETS: dict[str, DatasetCheck] = {
    "entries": _check_entries,
    "meshes": _check_meshes,
    "repeatable": _check_repeatable,
    "fresh process": _check_fresh_process,
    "inputs": _check_inputs,
}

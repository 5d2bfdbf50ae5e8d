"""A report of any number of shapes and methods, all of it made up: no file is read, no method is called."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.datasets.base import Entry
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.store import Store
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import contents
from benchmark.report.html.pages import Written, write_report
from benchmark.report.results import Result
from retrieval.metrics import evaluate
from tests.records import MEASURES, failed, record
from tests.toy import rod

REFUSED = "two components; join them"


@dataclass(frozen=True)
class MadeUp(ArtefactReader):
    """So many subjects, poses and methods; later methods keep more of the pose, and the last one makes no forms."""

    shape: tuple[int, int, int] = (2, 3, 2)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Each subject in each pose."""
        subjects, poses, _ = self.shape
        return tuple(Entry(f"s{k}-p{p}", f"s{k}", f"p{p}") for k in range(subjects) for p in range(poses))

    def dataset(self, _record: Any) -> Any:
        """The reader itself, as far as a data set is asked."""
        return self

    def surface(self, _record: Any, entry: Entry) -> Mesh | None:
        """A rod."""
        return rod(0.05 + 0.01 * int(entry.subject[1:]), 0.15 * int(entry.pose[1:]), rings=8, sides=8)

    def seen(self, _record: Any, _entry: Entry, surface: Mesh) -> Any:
        """Its vertices."""
        return surface.vertices

    def form(self, record: Any, entry: Entry, surface: Mesh | None = None) -> Mesh | str:
        """The rod made longer, or why there is none."""
        number = int(record["method"].removeprefix("method-"))
        if entry.identifier in dict(record["unsupported"]):
            return REFUSED
        surface = surface or self.surface(record, entry)
        stretched = surface.with_vertices(surface.vertices * (1 + number, 1, 1))
        return stretched if number < self.shape[2] - 1 else "it makes no forms"

    def distances(self, record: Any) -> Iterator[np.ndarray]:
        """Subjects and poses as points, with noise."""
        number, refused = int(record["method"].removeprefix("method-")), dict(record["unsupported"])
        subjects, poses, methods = self.shape
        generator = np.random.default_rng(number)
        of, at = np.divmod(np.arange(subjects * poses), poses)
        points = np.column_stack([np.eye(subjects)[of], np.eye(poses)[at] * number / methods])
        points += 0.25 * generator.standard_normal(points.shape)
        points = points[[k for k, entry in enumerate(self.entries) if entry.identifier not in refused]]
        yield np.linalg.norm(points[:, None] - points, axis=2)

    def records(self) -> list[dict[str, Any]]:
        """One for each method; the first refuses the first shape, and one more crashed."""
        names, labels = [e.identifier for e in self.entries], [e.subject for e in self.entries]
        data = {"n_shapes": len(names), "n_classes": self.shape[0]}
        made = []
        for number in range(self.shape[2]):
            refused = [[names[0], REFUSED]] if number == 0 else []
            found = record(f"method-{number}", shapes=names, labels=labels, data=data, unsupported=refused, **data)
            (distances,) = self.distances(found)
            values = evaluate(distances, labels[len(refused) :]).per_query
            per_query = {name: [*[0.0] * len(refused), *np.round(values[name], 6).tolist()] for name in MEASURES}
            scores = {name: float(np.mean(per_query[name])) for name in MEASURES}
            made.append(found | {"per_query": per_query, "scores": scores})
        return [*made, failed("crashed", "it <b>fell</b>", method="fell")]


def write_made_up(folder: Path, shape: tuple[int, int, int]) -> Written:
    """Write the report of so many subjects, poses and methods."""
    reader = MadeUp(Store.open(folder / "none"), {}, shape=shape)
    return write_report(contents([Result(each) for each in reader.records()]), reader, folder, "report")

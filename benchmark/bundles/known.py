"""Galleries as they are known here: from the data, or from records of the same shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from benchmark.datasets.catalogue import catalogued, is_present
from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.records import Record, answered_shapes, place
from benchmark.pipeline.storage.store import Store
from benchmark.protocols.galleries import Gallery, galleries
from benchmark.protocols.tables import TABLES


@dataclass(frozen=True)
class Known:
    """Data and records that bundles are compared with.

    Parameters
    ----------
    results
        Results folder whose records are looked at where data is not here.
    data_root
        Folder of the official data sets.
    folders
        Folders of meshes by the names of their data sets.
    """

    results: Path
    data_root: Path | None = None
    folders: Mapping[str, Path] = field(default_factory=dict)

    def gallery(self, record: Record) -> Gallery | None:
        """Return the gallery of a record; None where its data is not here. No path of the record is looked at."""
        name, quick = str(record["data"]["name"]), bool(record["data"]["quick"])
        if name in self.folders:
            source, tables = str(self.folders[name]), []
        elif catalogued(name) is not None and is_present(name, self.data_root):
            source = name
            tables = [t.identifier for t in TABLES if name in t.datasets and not (quick and t.ablation)]
        else:
            return None
        try:
            found = galleries(tables, [source], self.data_root, quick)
        except BenchmarkError:
            return None
        return next((gallery for gallery in found if gallery.name == record["gallery"]), None)

    @cached_property
    def _records(self) -> list[Record]:
        store = Store(self.results / "runs")
        return [record for records in (store.published, store.records) for record in records]

    def record_of_gallery(self, record: Record) -> Record | None:
        """Return a record of the same gallery and input that is here; of a known set also one of other shapes.

        Folders of two people may have one name.
        """
        rivals = [
            each
            for each in self._records
            if each["status"] == "ok" and (each["gallery"], each["input"]) == (record["gallery"], record["input"])
        ]
        same = (each for each in rivals if each["recipe"].get("gallery") == record["recipe"].get("gallery"))
        return next(same, rivals[-1] if rivals and catalogued(str(record["data"]["name"])) else None)

    def has_same(self, record: Record) -> bool:
        """Return whether a record here has the same scores in the same place, of the same shapes."""
        parts = ("scores", "labels", "shapes")
        return any(
            place(each) == place(record)
            and all(each.get(part) == record[part] for part in parts)
            and answered_shapes(each) == answered_shapes(record)
            and each["recipe"].get("gallery") == record["recipe"].get("gallery")
            for each in self._records
            if each["status"] == "ok"
        )

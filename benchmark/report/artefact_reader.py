"""Read the arrays of a record: distances, prepared shapes and canonical forms; nothing is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.own import is_own
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, ShapeError, one_line
from benchmark.geometry.camera import FRONT
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.artefact_ranking import matrices_of
from benchmark.pipeline.method_run import MethodRun, Preparation, require_arrays
from benchmark.pipeline.stages.shapes import form_mesh
from benchmark.pipeline.storage.records import Record, place
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.inspection import is_passed
from benchmark.plugins.registry import MethodSpec, variant
from benchmark.protocols.galleries import Gallery
from benchmark.protocols.models import find_models
from benchmark.report.content import own_table

#: Reason for a form that is not in the results folder.
NOT_STORED = "not kept here"


@dataclass(frozen=True)
class ArtefactReader:
    """Reader of the arrays of records in a results folder.

    Parameters
    ----------
    store
        Store of the folder.
    known
        Methods by name.
    data_root
        Folder of the official data sets.
    models
        Folder of locally trained models; None for that of the store.
    """

    store: Store
    known: Mapping[str, MethodSpec]
    data_root: Path | None = None
    models: Path | None = None
    _datasets: dict[str, ShapeSet | BenchmarkError] = field(default_factory=dict, repr=False, compare=False)
    _preparations: dict[tuple[str, Input], Preparation] = field(default_factory=dict, repr=False, compare=False)
    _method_runs: dict[str, MethodRun] = field(default_factory=dict, repr=False, compare=False)

    def distances(self, record: Record) -> Iterator[NDArray[Any]]:
        """Yield the distance matrices of a record, shape (N, N), one for each codebook; none if freed."""
        return (matrix for _, matrix in matrices_of(record, self.store))

    def dataset(self, record: Record) -> ShapeSet:
        """Return the data set of a record; raise ``BenchmarkError`` if it is missing."""
        source = record["data"]["source"]
        if source not in self._datasets:
            try:
                if is_own(source) and not is_passed(source.rpartition(":")[0]):
                    name = record["data"]["name"]
                    raise ConfigurationError(f"the plugin of data set {name} was not passed", "pass it")
                self._datasets[source] = open_dataset(source, self.data_root)
            except BenchmarkError as error:
                self._datasets[source] = error
            except Exception as error:  # of a plugin, which may raise anything
                self._datasets[source] = DatasetError(
                    f"{record['data']['name']} raises {one_line(error)}", "correct it"
                )
        dataset = self._datasets[source]
        if isinstance(dataset, BenchmarkError):
            raise dataset
        return dataset

    def preparation(self, record: Record) -> Preparation:
        """Return the prepared shapes of a record; raise ``BenchmarkError`` if its data set is missing."""
        place = (record["data"]["source"], record["input"])
        if place not in self._preparations:
            self._preparations[place] = Preparation(self.dataset(record), record["input"], self.store)
        return self._preparations[place]

    def method_run(self, record: Record) -> MethodRun:
        """Return the method of a record with its shapes; raise ``BenchmarkError`` if anything is missing."""
        key = record["key"]
        if key not in self._method_runs:
            preparation, spec = self.preparation(record), variant(record["method"], self.known)
            dataset, source = preparation.dataset, record["data"]["source"]
            shapes = set(record["shapes"])
            entries = tuple(entry for entry in dataset.shapes if entry.identifier in shapes)
            gallery = Gallery(own_table(dataset.name), source, dataset, entries, data_root=self.data_root)
            models = find_models(spec, gallery, self.models or self.store.models)
            self._method_runs[key] = MethodRun(preparation, self.store, spec, place(record).seed, models)
        return self._method_runs[key]

    def surface(self, record: Record, entry: Entry) -> Mesh | None:
        """Return a prepared shape; None if it is not stored or could not be prepared."""
        try:
            preparation = self.preparation(record)
            artefact = self.store.find(preparation.recipe(entry))
            arrays = None if artefact is None else require_arrays(artefact)
        except Exception:  # the data set or a plugin is missing
            return None
        return None if arrays is None else Mesh(arrays["vertices"], arrays["faces"])

    def seen(self, record: Record, entry: Entry, surface: Mesh) -> Points:
        """Return vertices in camera coordinates (right, up, towards the viewer), shape (n, 3)."""
        if record["input"] != "mesh":
            return surface.vertices
        try:
            camera = self.dataset(record).camera(entry)
        except Exception:  # of a plugin
            camera = FRONT
        return np.asarray(surface.vertices @ camera.rotation.T)

    def form(self, record: Record, entry: Entry, surface: Mesh | None = None) -> Mesh | str:
        """Return the canonical form of a shape, or the reason why there is none; ``surface`` is read unless passed."""
        try:
            method_run = self.method_run(record)
            if method_run.describes:
                return "it makes no forms"
            artefact = self.store.find(method_run.recipe(entry))
            arrays = None if artefact is None else require_arrays(artefact)
            surface = self.surface(record, entry) if surface is None else surface
            return NOT_STORED if arrays is None or surface is None else form_mesh(arrays, surface)
        except ShapeError as error:
            return str(error)
        except BenchmarkError as error:
            return error.problem
        except Exception as error:  # of a plugin, which may raise anything on creation
            return one_line(error)

"""Run the benchmark from Python, and read a results folder as pandas data frames and arrays.

>>> import benchmark
>>> records = benchmark.run(data="tosca", methods=["classic-mds", "gps"], input="mesh")     # doctest: +SKIP

>>> from benchmark.results import open_results
>>> results = open_results("results")
>>> records = results.records()
>>> key = records.query("gallery == 'tosca' and method == 'classic-mds' and input == 'mesh'").index[0]
>>> results.queries(key)        # one row for each shape: subject, NN, FT, ...
>>> results.distances(key)      # the distance matrix of the gallery
>>> results.forms(key)          # the canonical form of each shape
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.merging import job_name
from benchmark.pipeline.storage.records import Record, answered_shapes, by_place, scorer_name
from benchmark.pipeline.storage.store import StorageError, Store
from benchmark.plugins.inspection import inspect
from benchmark.plugins.registry import methods
from benchmark.plugins.scorers import scorers
from benchmark.report.results import Result, Results, line_of
from benchmark.text import DATA_VARIABLE, say

if TYPE_CHECKING:
    from pandas import DataFrame

    from benchmark.api.datasets import Entry
    from benchmark.geometry.mesh import Mesh
    from benchmark.report.artefact_reader import ArtefactReader

T = TypeVar("T")

__all__ = ["ResultsFolder", "frame_of", "open_results", "run"]


@dataclass(frozen=True)
class ResultsFolder:
    """Finished jobs of a results folder: those run here, and those that came with the suite.

    If several records belong to the same method, gallery, input, seed and scorer, the record that tables show is used.
    Every record has a *key*, which all methods except :meth:`records` take.

    Parameters
    ----------
    folder
        The results folder.
    data_root
        Folder of the official data sets; required to read forms of their shapes.
    plugins
        Plugin files of the methods, scorers and data sets to use.
    published
        Whether to ignore jobs run here and models trained here.
    """

    folder: Path
    data_root: Path | None = None
    plugins: tuple[Path, ...] = ()
    published: bool = False

    def records(self) -> DataFrame:
        """Return one row for each record, indexed by key.

        Returns
        -------
        pandas.DataFrame
            ``gallery``, ``dataset``, ``stand_in``, ``quick``, ``input``, ``method``, ``title``, ``family``, ``scorer``
            ("" for a descriptor), ``seed``, ``status``, ``reason``; each measure, a mean over queries in [0, 1], NaN
            without scores; chance levels (``chance_NN``, ...); ``n_shapes``, ``n_classes``, ``unsupported`` (number of
            shapes without a result), ``coverage`` (share of shapes with one); measures over these shapes only
            (``NN_supported``, ...), if some have no result; ``seconds`` per shape, ``peak_mib``, ``finished``,
            ``origin`` (``"here"`` or ``"published"``), and ``outdated`` (what has changed since the run; "" if nothing
            has).
        """
        return frame_of(self._results.values())

    def queries(self, *keys: str) -> DataFrame:
        """Return the measures of single queries, for some records or all.

        Parameters
        ----------
        *keys
            Keys of records; by default, all records with scores.

        Returns
        -------
        pandas.DataFrame
            One row for each shape of each record: ``key``, ``gallery``, ``input``, ``method``, ``scorer``, ``seed``,
            ``shape``, ``subject`` and each measure, NaN for the only shape of its class.

        Raises
        ------
        ConfigurationError
            If there is no such record, or it has no scores.
        """
        from pandas import DataFrame, concat

        wanted = keys or [key for key, result in self._results.items() if result.record["status"] == "ok"]
        frames = []
        for key in wanted:
            record = self._scored(key)
            head = {name: record[name] for name in ("gallery", "input", "method")} | {"scorer": scorer_name(record)}
            seed = int(record["recipe"].get("seed", 0))
            scores = {name: np.array(values, dtype=np.float64) for name, values in record["per_query"].items()}
            body = {"shape": record["shapes"], "subject": record["labels"], **scores}
            frames.append(DataFrame({"key": key, **head, "seed": seed, **body}))
        return concat(frames, ignore_index=True) if frames else DataFrame()

    def distances(self, key: str) -> DataFrame:
        """Return the dissimilarities of all pairs of shapes, averaged over codebooks if there are several.

        Returns
        -------
        pandas.DataFrame
            Shape (n, n), zero diagonal, symmetric except for some matrices of other programs; rows and columns are
            named by the shapes with a result.

        Raises
        ------
        ConfigurationError
            If there is no such record, or it has no scores.
        StorageError
            If the matrices are not stored here.
        """
        from pandas import DataFrame

        shapes = answered_shapes(self._scored(key))
        return DataFrame(self.distance_matrices(key).mean(axis=0), index=shapes, columns=shapes)

    def distance_matrices(self, key: str) -> NDArray[np.float64]:
        """Return the matrices before averaging: shape (k, N, N), one per codebook, in no particular order."""
        record = self._scored(key)
        matrices = list(self._artefacts.distances(record))
        if not matrices:
            raise self._absent(record, "distances")
        return np.stack(matrices).astype(np.float64)

    def forms(self, key: str) -> dict[str, Mesh]:
        """Return the canonical forms of the shapes with a result, in the order of the distance matrix.

        Raises
        ------
        ConfigurationError
            If there is no such record, it has no scores, or its method computes no forms.
        StorageError
            If some are not stored here, as computed by the current code.
        """
        record = self._scored(key)
        method_run = self._artefacts.method_run(record)
        if method_run.describes:
            raise ConfigurationError(f"{record['method']} makes no forms", "ask for its descriptors")
        return self._of_shapes(record, "forms", method_run.stored_form)

    def descriptors(self, key: str) -> DataFrame:
        """Return descriptors, one row for each shape; raises the errors of :meth:`forms`."""
        from pandas import DataFrame

        from benchmark.pipeline.method_run import require_arrays

        record = self._scored(key)
        method_run = self._artefacts.method_run(record)
        if not method_run.describes:
            raise ConfigurationError(f"{record['method']} describes no shapes", "ask for its forms")

        def vector(entry: Entry) -> Any:
            descriptor = self._store.find(method_run.recipe(entry))
            return None if descriptor is None else require_arrays(descriptor)["descriptor"]

        vectors = self._of_shapes(record, "descriptors", vector)
        return DataFrame.from_dict(vectors, orient="index").rename_axis("shape")

    # ------------------------------------------------------------------------------------------------------------------

    @cached_property
    def _store(self) -> Store:
        return Store(self.folder / "runs", published_only=self.published)

    @cached_property
    def _artefacts(self) -> ArtefactReader:
        from benchmark.report.artefact_reader import ArtefactReader

        return ArtefactReader(self._store, methods(self.plugins), self.data_root)

    @cached_property
    def _results(self) -> dict[str, Result]:
        known = Results(self._store, methods(self.plugins), self.data_root, scorers(self.plugins))
        places = by_place(self._store.all_records())
        seen = sorted({(place.seed, place.scorer) for place in places})
        chosen = (known.all(seed, scorer=scorer, places=places) for seed, scorer in seen)
        return {result.record["key"]: result for results in chosen for result in results}

    def _of_shapes(self, record: Record, what: str, read: Callable[[Entry], T | None]) -> dict[str, T]:
        """Return the stored content of each shape with a result, by name; raise ``StorageError`` if any is missing."""
        entries = {entry.identifier: entry for entry in self._artefacts.dataset(record).shapes}
        names = [name for name in answered_shapes(record) if name in entries]
        stored = {name: content for name in names if (content := read(entries[name])) is not None}
        if len(stored) < len(answered_shapes(record)):
            raise self._absent(record, what)
        return stored

    def _scored(self, key: str) -> Record:
        if key not in self._results:
            raise ConfigurationError(f"{self.folder} holds no record '{key}'", "take a key from records()")
        record = dict(self._results[key].record)
        if record["status"] != "ok":
            raise ConfigurationError(f"{job_name(record)} has no scores: {record['status']}", "choose a finished one")
        return record

    def _absent(self, record: Record, what: str) -> StorageError:
        changed = self._results[record["key"]].outdated
        reason = f"made before the last change ({changed})" if changed else "made elsewhere, or freed"
        return StorageError(f"the {what} of {job_name(record)} are not in {self.folder}: {reason}", "run it again here")


def open_results(
    folder: str | Path = "results",
    *,
    data_root: str | Path | None = None,
    plugins: Sequence[str | Path] = (),
    published: bool = False,
) -> ResultsFolder:
    """Open a results folder; see :class:`ResultsFolder`.

    Raises
    ------
    StorageError
        If there is no such folder.
    ConfigurationError
        If a plugin file cannot be used.
    """
    path, files = Path(folder), tuple(map(Path, plugins))
    root = data_root if data_root is not None else os.environ.get(DATA_VARIABLE)
    if not path.is_dir():
        raise StorageError(f"{path} is no folder", "name a results folder")
    inspect(files)
    return ResultsFolder(path, Path(root) if root else None, files, published)


def run(data: object = (), methods: object = (), input: object = (), **options: object) -> DataFrame:
    """Run the missing jobs of a selection, as on the command line; an interrupted run resumes.

    Parameters
    ----------
    data, methods, input
        Names or folders of data sets, names of methods, and ``"mesh"`` or ``"view"``; one value or a list.
    **options
        Other options of ``python -m benchmark run``, such as ``plugin="smooth.py"``, ``table=["I", "III"]``,
        ``results="results"``, ``quick=True``, ``jobs=2`` or ``timeout="10m"``.

    Returns
    -------
    pandas.DataFrame
        The records of the selection, as in :meth:`ResultsFolder.records`; failed jobs have a ``reason``.

    Raises
    ------
    ConfigurationError
        If the command line rejects the selection.
    """
    from pandas import read_json

    words = [*_words("dataset", data), *_words("method", methods), *_words("input", input)]
    words += [word for name, value in options.items() for word in _words(name, value)]
    with TemporaryDirectory() as folder:
        frame, line = Path(folder) / "frame.json", ""
        command = [sys.executable, "-m", "benchmark", "run", *words, "--frame", str(frame)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            try:
                for line in process.stdout or ():
                    say(line.rstrip())
            except BaseException:
                process.terminate()  # finished jobs are kept
                raise
        if not frame.is_file():
            problem, _, hint = line.strip().removeprefix("error: ").rpartition("; ")
            raise ConfigurationError(problem, hint)
        return read_json(frame, orient="table")


def _words(name: str, values: object) -> Iterator[str]:
    """Yield the words of an option on the command line."""
    for value in values if isinstance(values, list | tuple) else (values,):
        if value is not None and value is not False:
            yield from (f"--{name.replace('_', '-')}", *(() if value is True else (str(value),)))


def frame_of(results: Iterable[Result]) -> DataFrame:
    """Return one row for each record, indexed by key; see :meth:`ResultsFolder.records`."""
    from pandas import DataFrame

    rows = {result.record["key"]: _row(result) for result in results}
    return DataFrame.from_dict(rows, orient="index").rename_axis("key")


def _row(result: Result) -> dict[str, Any]:
    record, line = result.record, line_of([result], 1)
    data = record["data"]
    return {
        "gallery": record["gallery"],
        "dataset": data["name"],
        "stand_in": bool(data["stand_in_for"]),
        "quick": bool(data["quick"]),
        **{name: record[name] for name in ("input", "method", "title", "family")},
        "scorer": scorer_name(record),
        "seed": int(record["recipe"].get("seed", 0)),
        "status": record["status"],
        "reason": record.get("reason", ""),
        **(line["scores"] or {}),
        **{f"chance_{name}": value for name, value in (line["chance"] or data["chance"]).items()},
        "n_shapes": line["n_shapes"] or data["n_shapes"],
        "n_classes": line["n_classes"] or data["n_classes"],
        "unsupported": len(record.get("unsupported", ())),
        "coverage": line["coverage"],
        **{f"{name}_supported": value for name, value in line["supported"].items()},
        "seconds": np.nan if line["seconds"] is None else line["seconds"],
        "peak_mib": record.get("peak_mib"),
        "finished": record.get("finished", ""),
        "origin": result.origin,
        "outdated": line["outdated"] or result.outdated,
    }

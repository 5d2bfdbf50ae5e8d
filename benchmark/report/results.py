"""Read a results folder as pandas data frames, distance matrices and meshes.

>>> from benchmark import open_results
>>> results = open_results("results")
>>> results.scores.query("table == 'III' and method == 'gps' and measure == 'NN'")  # doctest: +SKIP
>>> job = results.job("gps", "tosca")  # doctest: +SKIP
>>> results.matches(job, "cat0")  # doctest: +SKIP
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame, Index, concat

from benchmark.defaults import DEFAULT_SCORER
from benchmark.errors import ConfigurationError, check_known
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.data_names import label_data_sets
from benchmark.pipeline.record_arrays import read_distances, read_form, read_vertex_map
from benchmark.pipeline.record_files import published_folder, read_records
from benchmark.pipeline.records import RankedShapes, Record
from benchmark.report.columns import JOBS, data_frame, scores_frame
from benchmark.report.record_facts import fold_of

__all__ = ["Results", "open_results"]


@dataclass(frozen=True)
class Results:
    """The finished jobs of a results folder, as tables show them.

    Parameters
    ----------
    folder
        The results folder.
    records
        One record a job: local ones first, published ones for the rest.
    """

    folder: Path
    records: tuple[Record, ...]

    @cached_property
    def scores(self) -> DataFrame:
        """All scores of full runs, one value a line, beside those that the paper prints.

        Columns: ``table``, ``dataset``, ``method``, ``input`` ("mesh", "view", or "paper" for what
        it prints), ``scorer`` ("" for descriptors and the paper), ``seed``, ``fold`` (part of the
        data set; "" for the whole one), ``measure``, and ``value`` in [0, 1], a mean over queries.
        """
        return scores_frame(record for record in self.records if not record.data.quick)

    @cached_property
    def jobs(self) -> DataFrame:
        """One line a job, indexed by its key.

        Columns: ``dataset``, ``fold``, ``quick``, ``kind``, ``input``, ``method``, ``title``,
        ``scorer``, ``seed``, ``status`` ("ok", "failed", ...), ``reason`` (or that of a refused
        shape), ``published``, ``commit``, ``finished``, ``coverage`` (share of shapes with a
        result), the measures (NaN without scores), ``n_shapes``, ``n_classes``, ``seconds`` and
        ``processor_seconds`` (NaN in old records) per shape, ``machine``.
        """
        keys = Index([record.key for record in self.records], name="job")
        return data_frame(JOBS, self.records).set_index(keys)

    @cached_property
    def queries(self) -> DataFrame:
        """One line for each shape of each job with scores.

        Columns: ``job``, ``dataset``, ``fold``, ``input``, ``method``, ``scorer``, ``seed``,
        ``shape``, ``class``, and the measures.
        """
        frames = [_queries_of(record) for record in self.records if record.status == "ok"]
        if not frames:
            return DataFrame()
        return concat(frames, ignore_index=True)

    def job(
        self,
        method: str,
        dataset: str,
        input: str = "mesh",
        fold: str = "",
        *,
        quick: bool = False,
        seed: int = 0,
        scorer: str = "",
    ) -> str:
        """Return the key of the finished job of a method on a data set.

        If several scorers ranked it, and none is named, the job of the default scorer is returned.

        Parameters
        ----------
        method, dataset
            Their names.
        input
            ``"mesh"`` or ``"view"``.
        fold
            Part of the data set, as ``"fold 0"``; "" for the whole one.
        quick
            Whether it is of a quick run.
        seed
            Seed of the run.
        scorer
            Name of the scorer.

        Raises
        ------
        ConfigurationError
            If no such job is finished.
        """
        jobs = self.jobs.query("seed == @seed and quick == @quick and status == 'ok'")
        wanted = {"method": method, "dataset": dataset, "input": input, "fold": fold}
        for column, value in wanted.items():
            jobs = jobs[jobs[column] == value]
        # Descriptors have no scorer ("").
        of_scorer = jobs[jobs["scorer"].isin(["", scorer or DEFAULT_SCORER])]
        if scorer or len(of_scorer):
            jobs = of_scorer
        if jobs.empty:
            place = " ".join(filter(None, (dataset, fold, "(quick)" if quick else "")))
            details = [input, f"seed {seed}" if seed else "", f"by {scorer}" if scorer else ""]
            listed = ", ".join(filter(None, details))
            problem = f"{self.folder} has no scores of {method} on {place}, {listed}"
            raise ConfigurationError(problem, "run it, or take a key from jobs.index")
        return str(jobs.index[0])

    def distances(self, job: str) -> DataFrame:
        """Return the distances of the queries of a job to its gallery, named by the shapes.

        Raises
        ------
        ConfigurationError
            If there is no such job, or its distances are not stored here, as those of most
            published jobs.
        """
        record = self._record(job)
        matrix = read_distances(self.folder, record)
        if matrix is None:
            raise ConfigurationError(
                f"the distances of {record.method} are not in {self.folder}", "run it here"
            )
        names = [_answered_shapes(side) for side in record.sides]
        return DataFrame(matrix, index=names[0], columns=names[-1])

    def form(self, job: str, shape: str) -> Mesh:
        """Return the canonical form of a shape that a job made.

        Its vertices are those of the file, in their order, unless some were removed; see
        :meth:`vertex_map`.

        Parameters
        ----------
        job
            Key of the job.
        shape
            Name of the shape.

        Raises
        ------
        ConfigurationError
            If there is no such job or shape, or its form is not stored here.
        """
        record = self._record(job)
        check_known("shape", [shape], record.shapes)
        form = read_form(self.folder, record, shape)
        if form is None:
            raise ConfigurationError(
                f"the form of {shape} by {record.method} is not in {self.folder}", "run it here"
            )
        vertex_map = read_vertex_map(self.folder, record, shape)
        if vertex_map is None:
            return form
        # Put the vertices into the order of the file, if all of its vertices are there.
        numbers, are_all = vertex_map  # place in the file of each vertex of the form
        if not are_all:
            return form
        faces = numbers[form.faces].astype(form.faces.dtype)
        return Mesh(form.vertices[np.argsort(numbers)], faces)

    def vertex_map(self, job: str, shape: str) -> NDArray[np.int64]:
        """Return the nearest vertex of the file at each vertex of the form of a shape, shape (n,).

        Raises
        ------
        ConfigurationError
            If the form is not stored here, or has vertices of its own, as forms of views have.
        """
        known = read_vertex_map(self.folder, self._record(job), shape)
        if known is None:
            problem = f"the form of {shape} has vertices of its own, or is not in {self.folder}"
            raise ConfigurationError(
                problem, "run a method that keeps the vertices of complete surfaces"
            )
        numbers, are_all = known
        return np.sort(numbers) if are_all else numbers

    def matches(self, job: str, query: str, count: int = 5) -> DataFrame:
        """Return the shapes that a job finds nearest to a query.

        Parameters
        ----------
        job
            Key of the job.
        query
            Name of the query, a shape of the data set. It is not among its matches.
        count
            Number of matches.

        Returns
        -------
        pandas.DataFrame
            ``rank``, ``shape``, ``class`` and ``distance``, nearest first.
        """
        record = self._record(job)
        matrix = self.distances(job)
        check_known("shape", [query], matrix.index)
        row = matrix.loc[query]
        if not record.keeps_same_names:
            row = row.drop(query, errors="ignore")
        order = np.argsort(row.to_numpy(), kind="stable")[:count]
        gallery = record.sides[-1]
        labels = dict(zip(gallery.shapes, gallery.labels, strict=True))
        shapes = [str(name) for name in row.index[order]]
        return DataFrame(
            {
                "rank": range(1, len(shapes) + 1),
                "shape": shapes,
                "class": [labels[name] for name in shapes],
                "distance": row.to_numpy()[order],
            }
        )

    def _record(self, job: str) -> Record:
        """Return the record of a job; raise ``ConfigurationError`` if there is none."""
        for record in self.records:
            if record.key == job:
                return record
        raise ConfigurationError(f"{self.folder} has no job '{job}'", "take a key from jobs.index")


def _answered_shapes(side: RankedShapes) -> list[str]:
    """Return the names of the shapes that have a result."""
    return [side.shapes[number] for number in side.answered]


def _queries_of(record: Record) -> DataFrame:
    """Return the measures of each query of a record, one line per shape of the data set."""
    return DataFrame(
        {
            "job": record.key,
            "dataset": record.data.name,
            "fold": fold_of(record),
            "input": record.input,
            "method": record.method,
            "scorer": record.scorer,
            "seed": record.seed,
            "shape": record.shapes,
            "class": record.labels,
            **record.per_query,
        }
    )


def open_results(path: str | Path = "results") -> Results:
    """Open a results folder; raise ``ConfigurationError`` if there is none.

    Where the default folder has no published records, those of the suite take their place.
    """
    folder = Path(path)
    if not (folder.is_dir() or published_folder(folder).is_dir()):
        raise ConfigurationError(f"{folder} is no folder", "name a results folder")
    return Results(folder, tuple(label_data_sets(read_records(folder))))

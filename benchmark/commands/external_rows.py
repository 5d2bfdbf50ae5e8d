"""Rows of tables for results of other programs: distances, and forms in mesh files."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import CanonicalForm, Input, MethodInfo, Shape
from benchmark.code_digest import code_of_modules, digest, digest_of_bytes
from benchmark.commands.score import Evaluation, score
from benchmark.commands.selection import as_sets
from benchmark.datasets.catalogue import folder_name, is_known
from benchmark.datasets.mesh_files import MESHES, mesh_stem, mesh_suffix, read_mesh
from benchmark.errors import ConfigurationError, ShapeError, UnsupportedShape
from benchmark.pipeline.cache import Cache, writing
from benchmark.pipeline.data_names import label_data_sets, records_of
from benchmark.pipeline.environment import commit, packages
from benchmark.pipeline.record_files import read_records, write_record
from benchmark.pipeline.records import EXTERNAL, Record, record_of
from benchmark.registry import Component
from benchmark.report.record_facts import fold_of
from benchmark.runs.tasks import STAGE_MODULES
from benchmark.text import brief, printable
from retrieval.measures import score_draws


def method_name(title: str) -> str:
    """Return the method name of an external row: ``external-TITLE``.

    No method of the suite can have it.

    Raises
    ------
    ConfigurationError
        If the title has neither letters nor digits.
    """
    words = re.sub("[^a-z0-9]+", "-", title.lower()).strip("-")
    if not words:
        raise ConfigurationError(f"'{title}' cannot be the title of a row", "use letters or digits")
    return f"{EXTERNAL}-{words[:50].rstrip('-')}"


def score_and_keep(
    distances: Path,
    labels: Path,
    order: str = "",
    *,
    results: Path,
    title: str = "",
    dataset: str = "",
    input: Input = "mesh",
) -> tuple[Evaluation, Record]:
    """Score distances in a file, and store them as a row of the tables.

    If there can be no row, that is said before all work.

    Parameters
    ----------
    distances, labels, order
        As for :func:`benchmark.score`.
    results
        The results folder.
    title
        Title of the row; by default the name of the file.
    dataset
        Name of the data set; by default the name of the labels.
    input
        Whether the distances are of surfaces or of views.
    """
    row = title or distances.stem
    of_labels = folder_name(labels) if labels.is_dir() else labels.resolve().stem
    name = dataset or of_labels
    record_beside(results, name, input, row)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # among the notes
        evaluation = score(distances, labels, order)
    return evaluation, keep_distances(results, evaluation, row, name, input)


def keep_distances(
    results: Path, evaluation: Evaluation, title: str, dataset: str, input_: Input
) -> Record:
    """Store distances of another program as a row of the tables, and return its record.

    The row stands beside those of methods on the same data. A row of the same title is replaced.

    Parameters
    ----------
    results
        The results folder.
    evaluation
        Distances with the names and classes of their shapes.
    title
        Title of the row.
    dataset
        Name of the data set or gallery. A name that is not known makes a table of its own.
    input_
        Whether the distances are of surfaces or of views.

    Raises
    ------
    ConfigurationError
        If the shapes have no names, or differ from those of the other rows.
    """
    beside = record_beside(results, dataset, input_, title)
    record, matrix = record_of_distances(evaluation, beside, dataset, title=title, input_=input_)
    with writing(results):
        same_row = [
            other for other in read_records(results, published=False) if other.row == record.row
        ]
        replaced = same_row[0] if same_row else None
        _check_title(record, replaced)
        Cache(results).write("records", record.key, {"distances": matrix})
        write_record(results, record, replaced.key if replaced else "")
    return record


def record_of_distances(
    evaluation: Evaluation, beside: Record | None, dataset: str, *, title: str, input_: Input
) -> tuple[Record, NDArray[np.float64]]:
    """Return a record of distances that another program computed, as if a method had made them.

    Parameters
    ----------
    evaluation
        The distances, with the names and classes of their shapes.
    beside
        A record of the same shapes, beside whose row they will stand; None for a table of their
        own.
    dataset
        Name of the data set or gallery.
    title
        Title of the row.
    input_
        Whether the distances are of surfaces or of views.

    Returns
    -------
    record : Record
        The record, with the scores of the distances.
    matrix : numpy.ndarray
        The distances in the order of the record's shapes, shape (N, N).

    Raises
    ------
    ConfigurationError
        If the shapes have no names, or differ from those of the other record.
    """
    _check_have_names(evaluation)
    labels = evaluation.queries["class"].to_dict()  # by the name of the shape
    gallery = _fields_of_gallery(beside) if beside else _fields_of_new_gallery(dataset, labels)
    known = dict(zip(gallery["shapes"], gallery["labels"], strict=True))
    if known != labels:
        raise _other_shapes(known, labels, gallery["gallery"])
    # Bring the shapes into the order of the other record.
    order = evaluation.queries.index.get_indexer(list(known))
    matrix = evaluation.distances[np.ix_(order, order)]

    code_of_measures = code_of_modules([STAGE_MODULES["records"]])
    digest_of_matrix = digest_of_bytes(matrix.tobytes())
    key = digest([gallery["gallery_digest"], input_, title, digest_of_matrix, code_of_measures])
    content = {
        **gallery,
        **score_draws([matrix], gallery["labels"]),
        "key": key,
        "status": "ok",
        "method": method_name(title),
        "title": brief(title),
        "family": EXTERNAL,
        "input": input_,
        "scorer": "",
        "scorer_title": "",
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "packages": packages(),
    }
    return record_of(msgspec.to_builtins(content)), matrix


def _other_shapes(
    known: Mapping[str, str], labels: Mapping[str, str], gallery: str
) -> ConfigurationError:
    """Return an error that says how labelled shapes differ from those of a gallery."""
    different = [name for name in labels if known.get(name) != labels[name]]
    problem = f"they are {len(labels)}, not {len(known)}"
    if different:
        problem = f"the first that differs is '{different[0]}'"
    first = " ".join(next(iter(known.items())))
    hint = f"name them with their classes as there ({first}, ...), or another --dataset"
    return ConfigurationError(f"the shapes are not those of '{gallery}': {problem}", hint)


def _check_have_names(evaluation: Evaluation) -> None:
    """Raise ``ConfigurationError`` if the shapes of some distances have no names."""
    are_row_numbers = evaluation.queries.index.dtype.kind == "i"
    if are_row_numbers:
        hint = (
            "name rows and columns in a CSV, or pass labels with lines 'name label' in the order "
            "of the rows"
        )
        raise ConfigurationError(
            "rows are paired by the names of shapes, and these distances have none", hint
        )


def record_beside(results: Path, dataset: str, input_: Input, title: str) -> Record | None:
    """Return the last record of a data set, beside whose row the row of another program will stand.

    The record says which shapes the data set has.

    Parameters
    ----------
    results
        The results folder.
    dataset
        Name of the data set or gallery.
    input_
        Whether the row is of surfaces or of views.
    title
        Title of the new row. An earlier row of this title, which it replaces, is passed over.

    Returns
    -------
    Record or None
        None if there is no data set of this name: the row gets a table of its own.

    Raises
    ------
    ConfigurationError
        If the data set is known, but has no row here, or the name cannot be that of a table.
    """
    method = method_name(title)
    (name,) = as_sets([dataset])
    every = read_records(results)
    beside = [
        record
        for record in _records_of_gallery(every, name)
        if record.input == input_
        and record.status == "ok"
        and record.method != method
        and not record.gallery_of_queries
    ]
    if beside:
        return beside[-1]
    # A folder may have rows of the other input or of quick runs alone.
    is_of_folder = any(record.data.path and record.data.name == name for record in every)
    if is_known(dataset) or Path(dataset).is_dir() or is_of_folder:
        problem = f"no row of '{dataset}', {input_}, is here, so its shapes are unknown"
        raise ConfigurationError(problem, "run a method on it first, or omit --dataset")
    if "/" in dataset or not dataset.strip() or not dataset.isprintable():
        raise ConfigurationError(
            f"'{dataset}' is neither a data set nor a folder", "name the table: --dataset mine"
        )
    return None


def _records_of_gallery(records: Sequence[Record], name: str) -> list[Record]:
    """Return the records of a whole data set, or of a gallery, of this name."""
    whole = [record for record in records if not (fold_of(record) or record.data.quick)]
    of_data = {record.key for record in records_of(label_data_sets(whole), [name])}
    return [record for record in records if record.key in of_data or record.gallery == name]


#: Fields of a record that say which shapes it ranks.
_GALLERY_FIELDS = ("gallery", "gallery_digest", "data", "shapes", "labels")


def _fields_of_gallery(record: Record) -> dict[str, Any]:
    """Return the fields of a record that say which shapes it ranks, for a record of the same."""
    return {name: getattr(record, name) for name in _GALLERY_FIELDS}


def _fields_of_new_gallery(dataset: str, labels: Mapping[str, str]) -> dict[str, Any]:
    """Return the fields that say which shapes a record ranks, for data that are not known here.

    Parameters
    ----------
    dataset
        Name that the user gives to the data; nothing else is known of their title and source.
    labels
        Class of each shape by its name.
    """
    return {
        "gallery": dataset,
        "gallery_digest": digest([dataset, *labels.items()]),
        "data": {"name": dataset, "title": dataset, "source": dataset},
        "shapes": list(labels),
        "labels": list(labels.values()),
    }


@dataclass(frozen=True, eq=False)
class ExternalForms:
    """Forms of another program in the mesh files of a folder, as a method of the normal runner.

    Parameters
    ----------
    info
        It names the files.
    folder
        The folder, with a mesh ``SHAPE.off``, or in another format, for each shape.
    """

    info: MethodInfo
    folder: Path

    def canonicalise(self, shape: Shape) -> CanonicalForm:
        """Return the form of a shape, centred; raise ``UnsupportedShape`` if there is none."""
        path = self.file_of(shape.identifier)
        if path is None:
            raise UnsupportedShape(f"{self.folder} has no form of this shape")
        try:
            mesh = read_mesh(path)
        except ShapeError as error:
            raise UnsupportedShape(error.located, error.hint) from error
        return CanonicalForm(mesh.vertices - mesh.vertices.mean(axis=0), mesh.faces)

    def file_of(self, name: str) -> Path | None:
        """Return the mesh file of a shape; None if there is none."""
        return self._files_by_name.get(name)

    @cached_property
    def _files_by_name(self) -> dict[str, Path]:
        """The mesh files of the folder by the names of their shapes; of several, the preferred."""
        files = [Path(file) for file in self.info.files]
        meshes = [path for path in files if mesh_suffix(path) in MESHES]
        meshes.sort(key=lambda path: MESHES.index(mesh_suffix(path)))
        by_name: dict[str, Path] = {}
        for path in meshes:
            parts = (*path.relative_to(self.folder).parent.parts, mesh_stem(path))
            by_name.setdefault("/".join(map(printable, parts)), path)
        return by_name


def forms_of(folder: Path, title: str) -> Component:
    """Return a method whose forms are files that another program has written into a folder.

    Parameters
    ----------
    folder
        Folder with a mesh file for each shape, named after it.
    title
        Title of the method.

    Raises
    ------
    ConfigurationError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "name the folder of the forms")
    # If one of the files changes, the results are stale.
    files = tuple(sorted(str(path) for path in folder.resolve().rglob("*") if path.is_file()))
    info = MethodInfo(name=method_name(title), title=brief(title), family="external", files=files)
    return Component(
        "method",
        info.name,
        f"{__name__}:ExternalForms",
        given=ExternalForms(info, folder.resolve()),
        state=title,
    )


def check_forms(job: Record, before: Record | None, forms: ExternalForms) -> None:
    """Raise ``ConfigurationError`` if no form is of a shape of a job, or its name is taken."""
    if job.gallery_of_queries:
        raise ConfigurationError(
            "forms of queries are others than those of their gallery", "omit -t or --gallery"
        )
    if not any(map(forms.file_of, job.shapes)):
        hint = f"name them like the shapes: {job.shapes[0]}.off"
        raise ConfigurationError(f"{forms.folder} has no form of these shapes", hint)
    _check_title(job, before)


def _check_title(record: Record, before: Record | None) -> None:
    """Raise ``ConfigurationError`` if the row of a record is another one of the same name."""
    if before and before.title != record.title:
        problem = f"'{before.title}' and '{record.title}' have one name, {record.method}"
        raise ConfigurationError(problem, "choose another title")

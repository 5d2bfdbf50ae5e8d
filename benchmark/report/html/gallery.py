"""The canonical forms of some shapes of a data set: pictures side by side, and surfaces that can be turned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
from PIL import Image

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.files import FolderDataset
from benchmark.errors import BenchmarkError
from benchmark.geometry.mesh import Mesh, Points
from benchmark.pipeline.storage.records import Record
from benchmark.protocols.tables import INPUTS
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.html.scripts import Files, add_picture, add_script
from benchmark.report.html.surfaces import Thinned, thinned
from benchmark.report.pictures.contact_sheet import select
from benchmark.report.pictures.painting import painted
from benchmark.report.pictures.posing import centred, reach, upright
from benchmark.text import brief

#: Pixels per side of a picture of a form.
TILE = 150

#: Poses of a subject, and subjects at most, that a gallery shows.
POSES, MOST_SUBJECTS = 4, 6

#: Width of a picture beyond what the largest form of its row takes.
_MARGIN = 1.06


@dataclass(frozen=True)
class Gallery:
    """Pictures of the forms of one data set in the report.

    Parameters
    ----------
    stem
        Name of its files.
    subjects
        Chosen shapes: for each subject its name and those of its shapes.
    inputs
        By input: methods with their titles, and for each shape what there is of each method, ``""`` for a form and else
        the reason why there is none.
    n_forms
        Forms that are there.
    hero
        Path of a picture of the first subject and one form of each of its poses; "" for none.
    """

    stem: str
    subjects: list[tuple[str, list[str]]]
    inputs: dict[Input, dict[str, Any]]
    n_forms: int
    hero: str

    def as_json(self) -> dict[str, Any]:
        """As the page reads it."""
        shapes = [shape for _, of_subject in self.subjects for shape in of_subject]
        return {
            "stem": self.stem,
            "tile": TILE,
            "subjects": [{"name": name, "shapes": of_subject} for name, of_subject in self.subjects],
            "files": {shape: number for number, shape in enumerate(shapes)},
            "inputs": self.inputs,
        }


@dataclass
class _Column:
    """One shape under one input: its surface and its forms, turned for the eye."""

    entry: Entry
    surface: Mesh | None = None
    thin: Thinned | None = None
    points: dict[str, Points] = field(default_factory=dict)
    meshes: dict[str, Mesh] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


def make_gallery(
    stem: str,
    records: Sequence[Record],
    artefacts: ArtefactReader,
    files: Files,
    *,
    most_shapes: int,
    poses: int = POSES,
) -> Gallery | None:
    """Write pictures and surfaces of some shapes of one data set under all methods that make forms.

    Parameters
    ----------
    stem
        Name of the files.
    records
        Records with scores of that data set, methods in the order in which they are shown.
    artefacts
        Where forms are.
    files
        Where they are added.
    most_shapes
        Shapes that the size of the report allows.
    poses
        Shapes of a subject.

    Returns
    -------
    Gallery
        What was written; None if no form is kept here.
    """
    chosen = _chosen(records, artefacts, most_shapes, poses)
    inputs: dict[Input, dict[str, Any]] = {}
    heroes: list[Image.Image] = []
    n_forms = 0
    for input_ in INPUTS:
        of_input = [record for record in records if record["input"] == input_]
        rows = {record["method"]: brief(record["title"]) for record in of_input}
        columns = [[_column(entry, of_input, artefacts) for entry in of_subject] for of_subject in chosen]
        found = sum(len(column.meshes) for of_subject in columns for column in of_subject)
        if not found:
            continue
        n_forms += found
        number = 0
        for of_subject in columns:
            _turn(of_subject, artefacts, of_input)
            widths = _widths(of_subject)
            for column in of_subject:
                _write(f"{stem}-{input_}-{number}", column, list(rows), widths, files)
                number += 1
            if len(heroes) < 1:
                heroes += _hero(of_subject, list(rows), widths)
        cells = {c.entry.identifier: [_told(c, name) for name in rows] for of_subject in columns for c in of_subject}
        inputs[input_] = {"methods": [{"name": name, "title": title} for name, title in rows.items()], "cells": cells}
    if not n_forms:
        return None
    hero = f"parts/pictures/hero-{stem}.webp" if heroes else ""
    if heroes:
        add_picture(files, f"hero-{stem}", heroes[0])
    names = [(of_subject[0].subject, [entry.identifier for entry in of_subject]) for of_subject in chosen]
    return Gallery(stem, names, inputs, n_forms, hero)


def _chosen(records: Sequence[Record], artefacts: ArtefactReader, most_shapes: int, poses: int) -> list[list[Entry]]:
    """Shapes that are shown: of subjects and poses spread over those that were ranked, the canonical pose first."""
    dataset = None
    ranked: set[str] = set()
    for record in records:
        ranked.update(record["shapes"])
        try:
            dataset = artefacts.dataset(record)
        except BenchmarkError:
            continue
    if dataset is None:
        return []
    entries = tuple(entry for entry in dataset.entries if entry.identifier in ranked)
    if not entries:
        return []
    n_poses = max(1, min(poses, max(poses - 1, most_shapes // poses), most_shapes))
    n_subjects = max(1, min(MOST_SUBJECTS, most_shapes // n_poses))
    part = replace(dataset, entries=entries) if isinstance(dataset, FolderDataset) else _Part(dataset, entries)
    return select(cast(Dataset, part), n_subjects, n_poses)


@dataclass(frozen=True)
class _Part:
    """Some shapes of a data set, as far as choosing among them needs it."""

    whole: Dataset
    entries: tuple[Entry, ...]

    @property
    def name(self) -> str:
        return self.whole.name


def _column(entry: Entry, records: Iterable[Record], artefacts: ArtefactReader) -> _Column:
    column = _Column(entry)
    for record in records:
        if entry.identifier not in record["shapes"]:
            column.missing.setdefault(record["method"], "not in this gallery")
            continue
        name = record["method"]
        if column.surface is None:
            column.surface = artefacts.surface(record, entry)
        found = artefacts.form(record, entry)
        if isinstance(found, str):
            column.missing.setdefault(name, brief(found))
        elif name not in column.meshes:
            column.meshes[name] = found
            column.missing.pop(name, None)
    return column


def _told(column: _Column, method: str) -> str:
    return "" if method in column.meshes else column.missing.get(method, "not run") or "not kept here"


#: Row of the shape itself.
INPUT_ROW = ""


def _turn(columns: Sequence[_Column], artefacts: ArtefactReader, records: Sequence[Record]) -> None:
    """Turn the surfaces as the camera sees them, and the forms as their surfaces stand, all poses alike."""
    models: dict[str, Points] = {}
    for column in columns:
        if column.surface is None:
            continue
        seen = artefacts.seen(records[0], column.entry, column.surface)
        column.points[INPUT_ROW] = centred(seen)
        column.thin = thinned(column.surface)
        for name, form in column.meshes.items():
            points = upright(form, column.surface, seen, models.get(name))
            column.points[name] = centred(points)
            models.setdefault(name, column.points[name])


def _widths(columns: Sequence[_Column]) -> dict[str, float]:
    """Half the width of the pictures of each method: the same for all poses of a subject, so that sizes can be told."""
    widths: dict[str, float] = {}
    for column in columns:
        for name, points in column.points.items():
            widths[name] = max(widths.get(name, 0.0), _MARGIN * reach(points))
    return widths


def _hero(columns: Sequence[_Column], methods: Sequence[str], widths: Mapping[str, float]) -> list[Image.Image]:
    """The shapes of a subject, and below them what the first method makes of all of them; nothing where none does."""
    shown = [column for column in columns if column.surface is not None and column.thin is not None]
    method = next((name for name in methods if shown and all(name in column.points for column in shown)), None)
    if method is None:
        return []
    image = Image.new("RGBA", (TILE * len(shown), 2 * TILE))
    for number, column in enumerate(shown):
        for row, name in enumerate((INPUT_ROW, method)):
            image.paste(_picture(column, name, widths[name]), (TILE * number, TILE * row))
    return [image]


def _picture(column: _Column, name: str, width: float) -> Image.Image:
    thin = _thinned(column, name)
    return painted((column.points[name] / width)[thin.chosen], thin.faces, thin.values, TILE, 1.0)


def _thinned(column: _Column, name: str) -> Thinned:
    """The vertices to show: those of the shape, unless the form has a surface of its own."""
    own = column.meshes.get(name)
    shared = own is None or (column.surface is not None and np.array_equal(own.faces, column.surface.faces))
    return column.thin if column.thin is not None and shared else thinned(column.meshes[name])


def _write(name: str, column: _Column, methods: Sequence[str], widths: Mapping[str, float], files: Files) -> None:
    """Write the strip of pictures of a shape, the shape itself on top, and the script with its surfaces."""
    strip = Image.new("RGBA", (TILE, TILE * (len(methods) + 1)))
    surfaces: dict[str, Any] = {}
    topology: dict[str, Any] = {}
    if column.thin is not None:
        topology = column.thin.topology()
        for row, method in enumerate((INPUT_ROW, *methods)):
            if method in column.points:
                thin = _thinned(column, method)
                own = {} if thin is column.thin else thin.topology()
                surfaces[method] = {"at": thin.positions(column.points[method] / widths[method])} | own
                strip.paste(_picture(column, method, widths[method]), (0, TILE * row))
    add_picture(files, f"forms-{name}", strip)
    add_script(files, f"forms-{name}", {"shape": column.entry.identifier, **topology, "surfaces": surfaces})

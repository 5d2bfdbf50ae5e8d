"""Pictures, data scripts and 3D viewers of canonical forms for the pages of a report."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import BenchmarkError
from benchmark.geometry.mesh import Mesh, Points
from benchmark.geometry.preparation import decimate
from benchmark.pipeline.storage.records import Record
from benchmark.protocols.tables import INPUTS
from benchmark.report.artefact_reader import NOT_STORED, ArtefactReader
from benchmark.report.pictures.painting import outwardness, painted
from benchmark.report.pictures.posing import SHAPE, posed, reach, select
from benchmark.text import brief, clean

#: Contents of files by path in the folder of the report.
Files = dict[str, bytes]

Progress = Callable[[str], None]
"""Called with each progress message."""

#: Characters with a meaning in HTML, for scripts inside pages.
_IN_HTML = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


def add_script(files: Files, name: str, value: Any) -> None:
    """Add a value as a script that a page loads by name."""
    text = f"canonicalForms.receive({script_json(name)},{script_json(value)});\n"
    files[f"parts/data/{name}.js"] = text.encode()


def add_picture(files: Files, name: str, image: Image.Image) -> str:
    """Add a picture, without date and version, and return its path."""
    stream = io.BytesIO()
    image.save(stream, format="WEBP", quality=84, method=4)
    files[f"parts/pictures/{name}.webp"] = stream.getvalue()
    return f"parts/pictures/{name}.webp"


def script_json(value: Any) -> str:
    """Return JSON that is also valid JavaScript inside a page, whatever its strings contain.

    Non-ASCII characters and those with a meaning in HTML are escaped. Numbers that JSON lacks become ``null``.
    """
    text = json.dumps(_plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for mark, escaped in _IN_HTML.items():
        text = text.replace(mark, escaped)
    return text


def _plain(value: Any) -> Any:
    """Return a value with cleaned strings, and None for numbers that JSON lacks."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {clean(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value


#: Pixels per side of a large picture; maximum number of shapes of a class, and of classes, with large pictures.
TILE, POSES, _MOST_CLASSES = 150, 4, 6

#: Maximum number of vertices of a surface in 3D; bound of its coordinates, in half widths of a picture.
_VERTICES, _REACH = 1000, 1.6

#: Width of a picture, relative to the largest form.
_MARGIN = 1.06

_ABSENT = "not in this gallery"


@dataclass
class Sheets:
    """The methods whose forms of a data set are drawn for one input, and the reasons for missing forms.

    Parameters
    ----------
    stem
        Prefix of the file names.
    titles
        Titles of the methods by name.
    reasons
        Reason why a form has no picture, by method and shape; "" if it has one.
    files
        Files to which finished sheets are added.
    """

    stem: str
    titles: dict[str, str]
    reasons: dict[str, dict[str, str]] = field(default_factory=dict)
    files: Files = field(default_factory=dict, repr=False)

    @property
    def numbers(self) -> dict[str, int]:
        """Number of each method in file names; 0 stands for the shapes themselves."""
        return {method: number for number, method in enumerate((SHAPE, *self.titles))}

    def as_json(self, shapes: Iterable[str]) -> dict[str, Any]:
        """Return methods, and reasons for missing pictures of some shapes, as read by the page."""
        reasons = [self.reasons.get(method, {}) for method in self.titles]
        return {
            "methods": [{"name": name, "title": title} for name, title in self.titles.items()],
            "cells": {shape: [of_method.get(shape, NOT_STORED) for of_method in reasons] for shape in shapes},
        }


@dataclass
class DrawnSet:
    """Pictures of a data set in the report.

    Parameters
    ----------
    stem
        Prefix of its file names.
    classes
        Names of the shapes with large pictures, by class.
    sheets
        Methods and missing forms by input.
    n_forms
        Number of forms in 3D.
    hero
        Path of a picture of the first class with one form of each of its shapes; "" for none.
    """

    stem: str
    classes: dict[str, list[str]] = field(default_factory=dict)
    sheets: dict[Input, Sheets] = field(default_factory=dict)
    n_forms: int = 0
    hero: str = ""

    @property
    def files(self) -> dict[str, int]:
        """Numbers, in file names, of the shapes with large pictures."""
        return {shape: number for number, shape in enumerate(chain(*self.classes.values()))}

    def as_json(self) -> dict[str, Any]:
        """Return the data for the page of forms."""
        inputs = {input_: sheets.as_json(self.files) for input_, sheets in self.sheets.items()}
        return {
            "stem": self.stem,
            "classes": [{"name": name, "shapes": shapes} for name, shapes in self.classes.items()],
            "files": self.files,
            "inputs": {input_: of for input_, of in inputs.items() if any("" in cell for cell in of["cells"].values())},
        }


def draw_set(
    stem: str,
    records: Sequence[Record],
    artefacts: ArtefactReader,
    files: Files,
    room: int,
) -> DrawnSet:
    """Draw the stored surfaces and forms of records.

    Parameters
    ----------
    stem
        Prefix of the file names.
    records
        Records with scores of one data set, in the order in which methods are shown.
    artefacts
        Reader of surfaces and forms.
    files
        Files to which pictures and scripts are added.
    room
        Maximum number of shapes with pictures for each input.
    """
    drawn = DrawnSet(stem)
    dataset = _dataset(records, artefacts)
    ranked = {shape for record in records for shape in record["shapes"]}
    entries = [entry for entry in dataset.shapes if entry.identifier in ranked] if dataset is not None else []
    if dataset is None or not entries:
        return drawn
    n_poses = max(1, min(POSES, max(POSES - 1, room // POSES), room))
    rows = select(dataset, entries, max(1, min(_MOST_CLASSES, room // n_poses)), n_poses)
    drawn.classes = {row[0].subject: [entry.identifier for entry in row] for row in rows}
    beside = set(drawn.files)
    entries = [entry for entry in entries if entry.identifier in beside]
    order = {entry.subject: number for number, entry in reversed([*enumerate(entries)])}
    entries.sort(key=lambda entry: (order[entry.subject], drawn.files[entry.identifier]))
    for input_ in INPUTS:
        by_method: dict[str, dict[str, Record]] = {}
        for record in (record for record in records if record["input"] == input_):
            sheets = drawn.sheets.setdefault(input_, Sheets(f"{stem}-{input_}", {}, files=files))
            sheets.titles.setdefault(record["method"], brief(record["title"]))
            of_method = by_method.get(record["method"], {})
            by_method[record["method"]] = dict.fromkeys(record["shapes"], record) | of_method
        if not by_method:
            continue
        for _, of_class in groupby(entries, key=lambda entry: entry.subject):
            models: dict[str, Points] = {}
            large: dict[str, dict[str, Mesh]] = {}
            for entry in of_class:
                meshes = _posed(entry, by_method, artefacts, models, sheets)
                if meshes:
                    large[entry.identifier] = meshes
            if large:
                _add_large(drawn, sheets, large)
    return drawn


def _dataset(records: Sequence[Record], artefacts: ArtefactReader) -> ShapeSet | None:
    for record in records:
        with suppress(BenchmarkError):
            return artefacts.dataset(record)
    return None


def _posed(
    entry: Entry,
    by_method: Mapping[str, Mapping[str, Record]],
    artefacts: ArtefactReader,
    models: dict[str, Points],
    sheets: Sheets,
) -> dict[str, Mesh]:
    """Return a shape and its forms by method, and note the reasons for missing ones; empty if it is not stored."""
    name = entry.identifier
    records = {method: of_method[name] for method, of_method in by_method.items() if name in of_method}
    if not records:
        return {}
    forms = posed(entry, next(iter(records.values())), records, artefacts, models)
    for method in by_method:
        form = forms.get(method, _ABSENT)
        sheets.reasons.setdefault(method, {})[name] = brief(form) if isinstance(form, str) else ""
    return {method: form for method, form in forms.items() if isinstance(form, Mesh)}


def _add_large(drawn: DrawnSet, sheets: Sheets, shapes: Mapping[str, Mapping[str, Mesh]]) -> None:
    """Write pictures of each shape and its forms as a strip, and surfaces as a script, at one scale per method."""
    rows = sheets.numbers
    widths: dict[str, float] = {}
    for method, mesh in chain.from_iterable(meshes.items() for meshes in shapes.values()):
        widths[method] = max(widths.get(method, 0.0), _MARGIN * reach(mesh.vertices))
    strips = []
    for shape, meshes in shapes.items():
        strip = Image.new("RGBA", (TILE, TILE * len(rows)))
        shared = _Thinned.of(meshes[SHAPE])
        surfaces: dict[str, Any] = {}
        for method, mesh in meshes.items():
            is_shared = np.array_equal(mesh.faces, meshes[SHAPE].faces)
            thin = shared if is_shared else _Thinned.of(mesh)
            points = mesh.vertices[thin.chosen] / widths[method]
            surfaces[method] = {"at": _packed(_steps(points))} | ({} if is_shared else thin.topology())
            strip.paste(painted(points, thin.faces, thin.values, TILE, 1.0), (0, TILE * rows[method]))
        name = f"forms-{sheets.stem}-{drawn.files[shape]}"
        add_picture(sheets.files, name, strip)
        add_script(sheets.files, name, {"shape": shape, **shared.topology(), "surfaces": surfaces})
        drawn.n_forms += len(meshes) - 1
        strips.append(strip)
    row = next((rows[method] for method in sheets.titles if all(method in meshes for meshes in shapes.values())), 0)
    if row and not drawn.hero:
        image = Image.new("RGBA", (TILE * len(strips), 2 * TILE))
        for column, strip in enumerate(strips):
            image.paste(strip.crop((0, 0, TILE, TILE)), (TILE * column, 0))
            image.paste(strip.crop((0, TILE * row, TILE, TILE * (row + 1))), (TILE * column, TILE))
        drawn.hero = add_picture(sheets.files, f"hero-{drawn.stem}", image)


@dataclass(frozen=True, eq=False)
class _Thinned:
    """Decimated mesh: some vertices of the mesh, triangles between them, and their outwardness."""

    chosen: NDArray[np.intp]
    faces: NDArray[np.int32]
    values: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: Mesh) -> _Thinned:
        small = decimate(mesh, _VERTICES)
        chosen = np.asarray(cKDTree(mesh.vertices).query(small.vertices)[1], dtype=np.intp)
        return cls(chosen, small.faces, outwardness(mesh)[chosen])

    def topology(self) -> dict[str, str]:
        return {
            "faces": _packed(self.faces.astype("<u2")),
            "values": _packed(np.rint(255 * self.values).astype("u1")),
        }


def _steps(points: Points) -> NDArray[np.uint16]:
    """Return coordinates in 65536 steps between plus and minus the reach, clipped to this range."""
    return np.asarray(np.rint((np.clip(points / _REACH, -1, 1) + 1) / 2 * 65535), dtype="<u2")


def _packed(array: NDArray[Any]) -> str:
    """Return whole numbers as base64, as read by the page."""
    return base64.b64encode(array.tobytes()).decode("ascii")

"""Export a data set; a generated one as a set that others can download, check and cite.

Beside its meshes and cameras, the folder of a generated set has

- ``README.md``, a data sheet: what the shapes are, how they are made, what they are not for;
- ``shapes.csv``: file, class, pose and fold of each shape;
- ``views`` and ``views.csv``, if they are wanted: depth images and their cameras;
- ``LICENSE.txt`` and ``CITATION.cff``;
- ``croissant.json``: the same facts for machines [Akhtar et al. 2024];
- ``SHA256SUMS``, which ``sha256sum --check`` reads.

All files follow from the set, so that every machine writes the same bytes.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import metadata, version
from pathlib import Path
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.commands.exported_views import CAMERAS, NEAREST, VIEWS, write_views
from benchmark.commands.exported_views import COLUMNS as CAMERA_COLUMNS
from benchmark.commands.selection import data_folder
from benchmark.datasets.base import Watched, by_subject
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.export import write_meshes
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.files import chunks_of
from benchmark.protocols.trainings import SUBJECT_FOLDS

#: Name of the distribution, whose metadata say where the project lies.
_PROJECT = "canonical-forms-benchmark"

#: Day of the release whose code makes the sets, as in the CHANGELOG.
RELEASED = "2026-11-29"

#: The generated set whose subjects have folds: it stands in for the paper's synthetic humans.
_WITH_FOLDS = "people[draw=0]"

#: Files that describe a set.
SHEET = "README.md"
SHAPES = "shapes.csv"
LICENCE = "LICENSE.txt"
CITATION = "CITATION.cff"
CROISSANT = "croissant.json"
SUMS = "SHA256SUMS"

#: Address of the licence of the generated sets, that of the project.
_LICENCE_URL = "https://spdx.org/licenses/MIT.html"

#: Context of the vocabulary, as the specification of Croissant 1.0 gives it.
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}

#: Columns of the table of shapes, with what they say.
_COLUMNS = {
    "file": "Mesh file",
    "shape": "Name of the shape in published results",
    "class": "Subject, which a query is to find",
    "pose": "Name of the pose, equal for equal poses",
    "fold": "Test fold of the subject in Table I, 0 to 2; empty where there are no folds",
}


def export(
    name: str,
    folder: str | Path,
    *,
    views: bool = False,
    data_root: str | Path | None = None,
    watched: Watched = iter,
) -> tuple[tuple[str, ...], list[str]]:
    """Write a data set as a folder that gives the same scores as the set.

    Parameters
    ----------
    name
        Name or folder of the data set. A generated set is described, too.
    folder
        Target folder, new or empty.
    views
        Whether to write the depth image of each shape, too; a run needs none.
    data_root
        Folder of the official data sets.
    watched
        Wraps the list of shapes while they are written, to show progress, as ``tqdm`` does.

    Returns
    -------
    files : tuple of str
        Names of the files.
    problems : list of str
        A line for each shape that is left out, as it cannot be read or no view shows it.

    Raises
    ------
    ConfigurationError
        If the folder is not empty or cannot be written, or a name cannot be that of a file.
    DatasetError
        If the set is not here, or no mesh is readable.
    """
    dataset = open_dataset(name, data_folder(data_root))
    unseen: list[str] = []  # problems of views

    def describe(target: Path, written: Mapping[str, Entry]) -> Sequence[str]:
        """Write views and descriptions beside the meshes, and return the names of the files."""
        further: list[str] = []
        if views:
            further, problems = write_views(target, watched)
            unseen.extend(problems)
        if dataset.folder is None:  # it is generated
            further += _write_descriptions(dataset, name, target, written, further)
        return further

    written, problems = write_meshes(dataset, Path(folder), watched=watched, describe=describe)
    return written, [*problems, *unseen]


def _write_descriptions(
    dataset: ShapeSet,
    name: str,
    folder: Path,
    written: Mapping[str, Entry],
    views: Sequence[str],
) -> list[str]:
    """Write the files that describe a generated data set into the folder of its meshes.

    They are a data sheet, a list of the shapes, licence and citation, a Croissant description for
    machines, and the SHA-256 of every file.

    Parameters
    ----------
    dataset
        The set.
    name
        Name by which the suite generates the set again.
    folder
        The folder. The meshes, the settings of the cameras and any views are written already.
    written
        The shapes by the name of their file.
    views
        Names of the files of the views; empty if there are none.

    Returns
    -------
    list of str
        Names of the written files.
    """
    texts = {
        SHEET: _data_sheet(dataset, name, written, has_views=bool(views)),
        SHAPES: _shapes_csv(dataset, written),
        LICENCE: _licence(),
        CITATION: _citation(dataset),
    }
    for file, text in texts.items():
        (folder / file).write_bytes(text.encode("utf-8"))

    # The Croissant description names the digests of all files before it.
    files = [*written, SETTINGS_FILE, *views, *texts]
    digests = {file: _digest(folder / file) for file in files}
    croissant = json.dumps(_croissant(dataset, digests), indent=1, ensure_ascii=False) + "\n"
    (folder / CROISSANT).write_bytes(croissant.encode("utf-8"))

    digests[CROISSANT] = _digest(folder / CROISSANT)
    sums = "".join(f"{digest}  {file}\n" for file, digest in sorted(digests.items()))
    (folder / SUMS).write_bytes(sums.encode("utf-8"))
    return [*texts, CROISSANT, SUMS]


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    digest = hashlib.sha256()
    for content in chunks_of(path):
        digest.update(content)
    return digest.hexdigest()


def _folds(dataset: ShapeSet) -> dict[str, int]:
    """Return the fold in which each subject is tested; empty for sets without folds."""
    if dataset.name != _WITH_FOLDS:
        return {}
    subjects = list(by_subject(dataset.shapes))
    folds = {}
    for fold, tested in enumerate(SUBJECT_FOLDS):
        for place in tested:
            folds[subjects[place]] = fold
    return folds


def _shapes_csv(dataset: ShapeSet, written: Mapping[str, Entry]) -> str:
    """Return the table of the shapes."""
    folds = _folds(dataset)
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(_COLUMNS)
    for file, entry in written.items():
        fold = folds.get(entry.subject, "")
        table.writerow([file, entry.identifier, entry.subject, entry.pose, fold])
    return stream.getvalue()


def _description(dataset: ShapeSet) -> str:
    """Return in a sentence what a set is."""
    n_classes = len(by_subject(dataset.shapes))
    return (
        f"{dataset.title}: {len(dataset.shapes)} generated triangle meshes of {n_classes} classes, "
        "for the retrieval of non-rigid 3D shapes."
    )


def _data_sheet(
    dataset: ShapeSet, name: str, written: Mapping[str, Entry], *, has_views: bool
) -> str:
    """Return the data sheet, after Gebru et al. (2021)."""
    members = by_subject(list(written.values()))
    numbers = sorted({len(shapes) for shapes in members.values()})
    poses = f"{numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else f"{numbers[0]}"
    stands_in = ""
    if dataset.stand_in_for:
        stands_in = (
            f"\nThe set stands in for `{dataset.stand_in_for}`, which may not be passed on. Scores "
            "on one say little about scores on the other.\n"
        )
    frame = "the frame is fitted to the largest shape"
    if dataset.half_width is not None:
        frame = f"the frame is {2 * dataset.half_width:g} units wide"
    views = ""
    option = ""
    if has_views:
        option = " --views"
        views = f"""
- `{VIEWS}/CLASS/POSE.png`: the depth image of each shape, with 16 bits. 0 is background; a value v
  lies z = (2 v / {NEAREST} - 1) half_width towards the camera, from the centre of the bounding box
  in the frame of the camera. The pixel in row r and column c lies at x = (c + 1/2) step -
  half_width and y = half_width - (r + 1/2) step, with step = 2 half_width / 500. Methods get the
  same images unrounded.
- `{CAMERAS}`: the camera of each image."""
    folds = "There are no splits: every shape is a query, and all others are its gallery."
    if _folds(dataset):
        folds = (
            "`shapes.csv` names the fold in which each subject is tested. Models for a fold are "
            "trained on the subjects of the two others. In whole galleries, every shape is a "
            "query, and all others are its gallery."
        )
    return f"""# {dataset.title}

{_description(dataset)}
Version {version(_PROJECT)} of the canonical forms benchmark wrote it:
`python -m benchmark data export '{name}'{option} -o FOLDER`.
{stands_in}
## Composition

- {len(written)} meshes `CLASS/POSE.off`: {len(members)} classes with {poses} poses each. No two
  meshes are alike.
- `dataset.toml`: the depth camera of each shape. Views are orthographic depth images of 500 x 500
  pixels along its `direction`, with `up` upwards; {frame}.
- `shapes.csv`: file, name, class, pose and fold of each shape.{views}
- `croissant.json`: the same for machines. `SHA256SUMS`: the digests, for `sha256sum --check`.

## Splits

{folds}

## How it was made

The shapes are generated; no person or animal was recorded. Bodies of people are those of the model
`anny` (code Apache-2.0, assets CC0), animals are this project's own. The same release writes the
same bytes on every machine.

## Use

Scores of a method are comparable with published ones if the same classes and poses are ranked:

    python -m benchmark run -d FOLDER -m METHOD

Draw no conclusions about real people or animals. Choose no parameters on these shapes if you report
scores on them. Networks may not have seen the subjects of a test.

## Licence and citation

MIT, see `LICENSE.txt`. Please cite `CITATION.cff`.
"""


def _licence() -> str:
    """Return the text of the licence (MIT), with the year and the holder of the suite's own."""
    holder = metadata(_PROJECT)["Author"]
    return f"""MIT License

Copyright (c) {RELEASED[:4]} {holder}

Permission is hereby granted, free of charge, to any person obtaining a copy of these data and
associated files (the "Data"), to deal in the Data without restriction, including without limitation
the rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the
Data, and to permit persons to whom the Data are furnished to do so, subject to the following
conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial
portions of the Data.

THE DATA ARE PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT
LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT.
IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE DATA OR THE USE OR OTHER DEALINGS IN THE DATA.
"""


def _citation(dataset: ShapeSet) -> str:
    """Return how to cite the data, as a ``CITATION.cff`` file."""
    holder = metadata(_PROJECT)["Author"]
    return f"""cff-version: 1.2.0
message: Please cite these data, and the version of the benchmark that generated them.
title: {json.dumps(_cited_title(dataset), ensure_ascii=False)}
type: dataset
authors:
  - name: {holder}
license: MIT
version: {version(_PROJECT)}
date-released: {RELEASED}
"""


def _cited_title(dataset: ShapeSet) -> str:
    """Return the title of the set as it is cited."""
    return f"Canonical forms benchmark: {dataset.title}"


def _address() -> str:
    """Return where the project lies, as its metadata say."""
    addresses = dict(
        text.split(", ", 1) for text in metadata(_PROJECT).get_all("Project-URL") or ()
    )
    return str(addresses.get("Repository", ""))


def _croissant(dataset: ShapeSet, digests: Mapping[str, str]) -> dict[str, Any]:
    """Return a description of a data set for machines: Croissant 1.0, a vocabulary of JSON-LD.

    Parameters
    ----------
    dataset
        The set.
    digests
        SHA-256 of each of its files, by name.
    """
    holder = metadata(_PROJECT)["Author"]
    cited = f"{holder}, {_cited_title(dataset)}, version {version(_PROJECT)}, {RELEASED[:4]}"
    # Record sets describe the columns of the CSV files.
    record_sets = [_record_set("shapes", "One record for each shape.", SHAPES, "file", _COLUMNS)]
    if CAMERAS in digests:
        says = "One record for each depth image."
        record_sets.append(_record_set("views", says, CAMERAS, "view", CAMERA_COLUMNS))
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": dataset.name,
        "description": _description(dataset),
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "citeAs": cited,
        "license": _LICENCE_URL,
        "url": _address(),
        "version": version(_PROJECT),
        "datePublished": RELEASED,
        "creator": {"@type": "sc:Organization", "name": holder},
        "distribution": [_file_object(file, digest) for file, digest in digests.items()],
        "recordSet": record_sets,
    }


def _record_set(name: str, says: str, table: str, key: str, columns: Mapping[str, str]) -> Any:
    """Return the description of a table whose rows are records."""
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": says,
        "key": {"@id": f"{name}/{key}"},
        "field": [_field(name, table, column, meaning) for column, meaning in columns.items()],
    }


def _file_object(file: str, digest: str) -> dict[str, Any]:
    """Return the Croissant description of one file, with its SHA-256."""
    formats = {
        ".off": "model/vnd.off",
        ".csv": "text/csv",
        ".png": "image/png",
        ".md": "text/markdown",
        ".toml": "application/toml",
        ".cff": "application/yaml",
    }
    return {
        "@type": "cr:FileObject",
        "@id": file,
        "name": file,
        "contentUrl": file,
        "encodingFormat": formats.get(Path(file).suffix, "text/plain"),
        "sha256": digest,
    }


def _field(record_set: str, table: str, column: str, says: str) -> dict[str, Any]:
    """Return the description of a column of a table."""
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{column}",
        "name": column,
        "description": says,
        "dataType": "sc:Text",
        "source": {"fileObject": {"@id": table}, "extract": {"column": column}},
    }

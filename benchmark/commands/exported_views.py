"""Views of an exported data set: depth images as pictures of 16 bits, with their cameras."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmark.datasets.base import Watched
from benchmark.datasets.folder import folder_set
from benchmark.errors import ShapeError
from benchmark.geometry.camera import Camera
from benchmark.pipeline.prepared import frame_of
from benchmark.pipeline.views import prepare_view

#: Folder of the depth images, and the table of their cameras.
VIEWS = "views"
CAMERAS = "views.csv"

#: Value of a picture at the near plane; 0 is background.
NEAREST = 65535

#: Columns of the table of cameras, with what they say.
COLUMNS = {
    "view": "File of the depth image",
    "file": "Mesh that it shows",
    "class": "Subject, which a query is to find",
    "direction": "Direction in which the camera looks, in coordinates of the mesh",
    "up": "Direction that is up in the image",
    "half_width": "Half the width, height and depth of what it shows, in units of the mesh",
}


def write_views(folder: Path, watched: Watched = iter) -> tuple[list[str], list[str]]:
    """Write the depth image of each shape of an exported set, and a table of their cameras.

    The images are those that methods get, as PNG files with 16 bits a pixel. Rounding hides most
    differences between processors.

    Parameters
    ----------
    folder
        The folder of the set.
    watched
        Wraps the list of shapes while they are rendered, to show progress, as ``tqdm`` does.

    Returns
    -------
    files : list of str
        Names of the files.
    problems : list of str
        A line for each shape that no view shows.
    """
    shapes = folder_set(folder)
    half_width = frame_of(shapes)
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(COLUMNS)
    written: list[str] = []
    problems: list[str] = []
    for entry in watched(shapes.shapes):
        file = f"{entry.identifier}.off"
        view = f"{VIEWS}/{entry.identifier}.png"
        camera = shapes.camera(entry)
        try:
            depth = prepare_view(shapes.load(entry), camera, half_width)["depth"]
        except ShapeError as error:
            problems.append(f"{view}: {error}")
            continue
        (folder / view).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(_in_16_bits(depth)).save(folder / view)
        table.writerow([view, file, entry.subject, *_in_words(camera), repr(float(half_width))])
        written.append(view)
    (folder / CAMERAS).write_bytes(stream.getvalue().encode("utf-8"))
    return [*written, CAMERAS], problems


def _in_16_bits(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return depths from 0 to 1 as whole numbers; 0 is background alone."""
    values = np.round(depth.astype(np.float64) * NEAREST)
    values = np.where(depth > 0, np.maximum(values, 1), 0)
    return values.astype(np.uint16)


def _in_words(camera: Camera) -> Sequence[str]:
    """Return the direction of a camera, and what is up in its image, as three numbers each."""
    return [_numbers(camera.direction), _numbers(camera.up)]


def _numbers(vector: Iterable[float]) -> str:
    """Return numbers as text, with all of their digits and blanks between them."""
    return " ".join(repr(float(x)) for x in vector)

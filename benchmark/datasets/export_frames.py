"""Write the frames of a generated depth camera as files that a folder of depth images is read from."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from benchmark.datasets.base import Entry, Watched
from benchmark.datasets.camera_frames import CameraFrames
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.reading import DEFAULT_SCALE
from benchmark.errors import ConfigurationError

CAMERA_FILE = "camera.json"


def export_frames(
    dataset: CameraFrames, folder: Path, *, force: bool = False, watched: Watched = iter
) -> tuple[str, ...]:
    """Write each frame as ``CLASS/POSE.png`` in millimetres with ``CLASS/POSE_mask.png``, and ``camera.json``.

    Parameters
    ----------
    dataset, folder, force, watched
        As of :func:`benchmark.datasets.export.export`.

    Returns
    -------
    tuple of str
        Names of the files.

    Raises
    ------
    ConfigurationError
        If the folder is not empty, or cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "choose another one")
    if folder.exists() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty", "choose another folder, or pass --force to write into it")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as name:
            made = Path(name)
            names = [file for entry in watched(dataset.entries) for file in _write(dataset, entry, made)]
            (made / CAMERA_FILE).write_text(_open3d(dataset.intrinsics), encoding="utf-8")
            for file in (*names, CAMERA_FILE):
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (made / file).replace(folder / file)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}", "choose another folder") from error
    return (*names, CAMERA_FILE)


def _write(dataset: CameraFrames, entry: Entry, folder: Path) -> tuple[str, str]:
    depths, mask = dataset.frame(entry)
    names = (f"{entry.subject}/{entry.pose}.png", f"{entry.subject}/{entry.pose}_mask.png")
    (folder / entry.subject).mkdir(exist_ok=True)
    Image.fromarray(np.round(depths * DEFAULT_SCALE).astype(np.uint16)).save(folder / names[0])
    Image.fromarray(mask).save(folder / names[1])
    return names


def _open3d(camera: Intrinsics) -> str:
    """Intrinsics as Open3D writes them, column by column."""
    width, height = camera.size or (0, 0)
    columns = [camera.fx, 0, 0, 0, camera.fy, 0, camera.cx, camera.cy, 1]
    return json.dumps({"width": width, "height": height, "intrinsic_matrix": columns}, indent=1) + "\n"

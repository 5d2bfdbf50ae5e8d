"""Settings of a folder of meshes in ``dataset.toml``: canonical poses, depth cameras, frame."""

from __future__ import annotations

import dataclasses
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmark.datasets.files import FolderDataset, is_there, text_of
from benchmark.errors import ConfigurationError, DatasetError, did_you_mean
from benchmark.geometry.camera import FRONT, SIDE, Camera

SETTINGS_FILE = "dataset.toml"

#: Cameras by name, for shapes with z up that face -y.
VIEWS: Mapping[str, Camera] = {
    "front": FRONT,
    "side": SIDE,
    "back": Camera((0.0, -1.0, 0.0)),
    "other-side": Camera((-1.0, 0.0, 0.0)),
}

_KEYS = ("camera", "canonical_pose", "half_width", "stand_in_for", "up")


def with_settings(dataset: FolderDataset) -> FolderDataset:
    """Apply the ``dataset.toml`` of the folder, if there is one.

    All keys are optional: ``camera``, the name of a view, a table with ``direction`` and optionally ``up``, or a table
    from class to either; ``up`` (``"z"`` or ``"y"``), the up axis of the files for the named views; ``canonical_pose``,
    a pose or a table from class to pose; ``half_width``, half the width of the camera's frame in file units;
    ``stand_in_for``, the official set that generated shapes replace.

    Raises
    ------
    ConfigurationError
        If a key, view, class or pose is unknown; the message suggests similar names.
    DatasetError
        If the file is unreadable, or a value has the wrong type.
    """
    path = dataset.folder / SETTINGS_FILE
    if not is_there(path):
        return dataset
    values = read_settings(path, _KEYS)
    if values.get("up", "z") not in ("y", "z"):
        raise DatasetError(f"{path}: up is {values['up']!r}", 'write up = "z" or up = "y"')
    poses: dict[str, list[str]] = {}
    for entry in dataset.entries:
        poses.setdefault(entry.subject, []).append(entry.pose)
    changes: dict[str, Any] = {}
    if "half_width" in values:
        changes["half_width"] = _half_width(values["half_width"], path)
    if "stand_in_for" in values:
        changes["stand_in_for"] = _stand_in_for(values["stand_in_for"], path)
    if "canonical_pose" in values:
        chosen = _canonical_poses(values["canonical_pose"], poses, path)
        changes["canonical_poses"] = {**dataset.canonical_poses, **chosen}
    if "camera" in values:
        cameras = _cameras(values["camera"], values.get("up", "z"), poses, path)
        changes["camera_for"] = lambda entry: cameras.get(entry.subject) or dataset.camera(entry)
    elif values.get("up", "z") == "y":
        changes["camera_for"] = lambda entry: _y_up(dataset.camera(entry))
    return dataclasses.replace(dataset, **changes)


def read_settings(path: Path, keys: Iterable[str], where: str = "") -> dict[str, Any]:
    """Read a settings file; raises ``ConfigurationError`` for unknown keys, ``DatasetError`` if it is unreadable."""
    try:
        values = tomllib.loads(text_of(path))
    except (ValueError, RecursionError) as error:  # including huge numbers and deep nesting
        raise DatasetError(f"cannot read {path}: {error}", "correct the file or remove it") from error
    for key in values:
        if key not in keys:
            raise did_you_mean(f"key of {path}{where}", key, keys)
    return values


def _half_width(value: Any, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= sys.float_info.max:
        raise DatasetError(f"{path}: half_width is {value!r}", "write a positive number in units of the files")
    return float(value)


def _stand_in_for(value: Any, path: Path) -> str:
    if not isinstance(value, str) or not value:
        raise DatasetError(f"{path}: stand_in_for is {value!r}", "write the name of the official set in quotes")
    return value


def _canonical_poses(value: Any, poses: Mapping[str, list[str]], path: Path) -> dict[str, str]:
    by_subject = value if isinstance(value, dict) else dict.fromkeys(poses, value)
    chosen = {}
    for subject, pose in by_subject.items():
        if subject not in poses:
            raise did_you_mean(f"class under canonical_pose in {path}", subject, poses)
        if isinstance(pose, bool) or not isinstance(pose, int | str):
            raise DatasetError(f"{path}: the canonical pose of '{subject}' is {pose!r}", "write a pose in quotes")
        if str(pose) not in poses[subject]:
            raise did_you_mean(f"pose of class '{subject}' in {path}", str(pose), poses[subject])
        chosen[subject] = str(pose)
    return chosen


def _cameras(value: Any, up: str, subjects: Iterable[str], path: Path) -> dict[str, Camera]:
    known = list(subjects)
    if not isinstance(value, dict) or "direction" in value:
        return dict.fromkeys(known, _camera(value, up, path))
    for subject in value:
        if subject not in known:
            raise did_you_mean(f"class under camera in {path}", subject, known)
    return {subject: _camera(camera, up, path) for subject, camera in value.items()}


def _camera(value: Any, up: str, path: Path) -> Camera:
    if isinstance(value, str):
        if value not in VIEWS:
            raise did_you_mean(f"camera in {path}", value, VIEWS)
        return _y_up(VIEWS[value]) if up == "y" else VIEWS[value]
    hint = "write the name of a view, or { direction = [x, y, z], up = [x, y, z] }"
    if not isinstance(value, dict) or "direction" not in value:
        raise DatasetError(f"{path}: {value!r} is no camera", hint)
    for key in value:
        if key not in ("direction", "up"):
            raise did_you_mean(f"key of a camera in {path}", key, ("direction", "up"))
    default = (0.0, 1.0, 0.0) if up == "y" else (0.0, 0.0, 1.0)
    try:
        return Camera(_vector(value["direction"]), _vector(value["up"]) if "up" in value else default)
    except (TypeError, ValueError, OverflowError) as error:
        raise DatasetError(f"{path}: {error}", hint) from error
    except ConfigurationError as error:
        raise DatasetError(f"{path}: {error.problem}", error.hint) from error


def _vector(value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or any(isinstance(x, bool) or not isinstance(x, int | float) for x in value):
        raise TypeError(f"{value!r} is no vector")
    x, y, z = map(float, value)
    return x, y, z


def _y_up(camera: Camera) -> Camera:
    """Convert a camera to shapes with y up that face +z; cameras with y up are returned unchanged."""
    if camera.up == (0.0, 1.0, 0.0):
        return camera
    (x, y, z), (a, b, c) = camera.direction, camera.up
    return Camera((x, z, -y), (a, c, -b))

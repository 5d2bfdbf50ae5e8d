"""Settings of a folder in ``dataset.toml``: canonical poses, depth cameras, frame."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import by_subject
from benchmark.datasets.units import mesh_in_metres, of_unit_area
from benchmark.errors import ConfigurationError, DatasetError, check_known
from benchmark.files import LARGEST_LIST, decode, named_errors, read_file
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.geometry.mesh import Mesh

Value = TypeVar("Value")

SETTINGS_FILE = "dataset.toml"

#: Cameras by name, for shapes with z up that face -y.
VIEWS: Mapping[str, Camera] = {
    "front": FRONT,
    "side": SIDE,
    "back": Camera((0.0, -1.0, 0.0)),
    "other-side": Camera((-1.0, 0.0, 0.0)),
}

#: Most dots in a key, for which parsing takes the square of their number.
_MOST_DOTS = 20

#: Metres of a unit.
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}

_KEYS = ("camera", "canonical_pose", "half_width", "normalise", "stand_in_for", "unit", "up")


def with_settings(shapes: ShapeSet) -> ShapeSet:
    """Return a data set of meshes with the settings of the ``dataset.toml`` in its folder.

    Without such a file, nothing changes. All keys are optional:

    - ``camera``: the name of a view, a table with ``direction`` and optionally ``up``, or a table
      with one of these for each class or shape;
    - ``up``: the up axis of the files for named views, ``"z"`` or ``"y"``;
    - ``canonical_pose``: a pose, or a table with a pose for each class;
    - ``unit``: a key of :data:`METRES`, a number of metres, or a table with one of these for each
      class or shape; shapes are then scaled to metres;
    - ``normalise = "area"``: shapes are scaled to unit area;
    - ``half_width``: half the width of the camera's frame, in the unit of the scaled shapes
      (metres, or the root of their area), or else of the files;
    - ``stand_in_for``: the official set that generated shapes replace.

    Raises
    ------
    ConfigurationError
        If a key, view, class or pose is unknown; the message suggests similar names.
    DatasetError
        If the file is unreadable, or a value has the wrong type.
    """
    # What the file sets is collected as fields of the data set to replace.
    path = (shapes.folder or Path()) / SETTINGS_FILE
    values = read_settings(path, _KEYS)
    up = values.get("up", "z")
    if up not in ("y", "z"):
        raise DatasetError(f"{path}: up is {up!r}", 'write up = "z" or up = "y"')
    chosen = canonical_poses(values.get("canonical_pose", {}), shapes.shapes, path)
    changes: dict[str, Any] = {
        "canonical_poses": {**shapes.canonical_poses, **chosen},
        "stand_in_for": _replaced_set(values.get("stand_in_for", shapes.stand_in_for), path),
    }
    if "half_width" in values:
        changes["half_width"] = positive(values["half_width"], "half_width", path)
    if values.get("normalise", "area") != "area":
        problem = f"{path}: normalise is {values['normalise']!r}"
        raise DatasetError(problem, 'write normalise = "area", or remove it')
    if "unit" in values or "normalise" in values:
        read_unit = partial(_metres, path=path)
        unit_of = _by_name(values.get("unit", 1), "unit", read_unit, shapes, path)
        resized = _Resized(shapes, unit_of, is_normalised="normalise" in values)
        changes |= {"load": resized.load, "key": resized.key, "code": resized.code}

    def usual_camera(entry: Entry) -> Camera:
        """Return the camera of a shape for which the file names none."""
        camera = shapes.camera(entry)
        return _y_up(camera) if up == "y" else camera

    changes["camera"] = usual_camera
    if "camera" in values:
        cameras = _by_name(
            values["camera"], "camera", lambda value: _camera(value, up, path), shapes, path
        )
        changes["camera"] = lambda entry: cameras(entry) or usual_camera(entry)
    return replace(shapes, **changes)


@dataclass(frozen=True)
class _Resized:
    """Functions of a data set whose meshes get another size.

    Parameters
    ----------
    shapes
        The data set.
    unit_of
        Returns the unit of the file of a shape in metres; None if nothing is said of it, for 1.
    is_normalised
        Whether meshes get unit area, instead of metres.
    """

    shapes: ShapeSet
    unit_of: Callable[[Entry], float | None]
    is_normalised: bool

    def load(self, entry: Entry) -> Mesh:
        """Return the mesh of unit area, or in metres."""
        mesh = self.shapes.load(entry)
        if self.is_normalised and mesh.area:
            return of_unit_area(mesh)
        return mesh_in_metres(mesh, self.unit_of(entry) or 1.0)

    def key(self, entry: Entry) -> str:
        """Return what determines the mesh: that of the file, and how its size changes."""
        size = "area" if self.is_normalised else self.unit_of(entry) or 1.0
        return f"{self.shapes.key(entry)} {size}"

    def code(self, entry: Entry) -> Sequence[str]:
        """Return the modules that determine the mesh."""
        return (*self.shapes.code(entry), of_unit_area.__module__)


def read_settings(path: Path, keys: Iterable[str], where: str = "") -> dict[str, Any]:
    """Read a settings file; empty if there is none.

    Raises
    ------
    ConfigurationError
        If a key is unknown.
    DatasetError
        If it is unreadable.
    """
    if not (path.is_symlink() or path.exists()):
        return {}
    with named_errors(path, "settings file", DatasetError, "correct the file or remove it"):
        text = decode(read_file(path, LARGEST_LIST))
        if max(part.count(".") for part in re.split("[,=\n]", text)) > _MOST_DOTS:
            raise ValueError("a key has too many dots")
        values = tomllib.loads(text)
    check_known(f"key of {path}{where}", values, keys)
    return values


def positive(value: Any, key: str, path: Path) -> float:
    """Return a positive number of a settings file; raise ``DatasetError`` if it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 10**300:
        raise DatasetError(f"{path}: {key} is {value!r}", "write a positive number")
    return float(value)


def canonical_poses(value: Any, entries: Iterable[Entry], path: Path) -> dict[str, str]:
    """Return the canonical pose of each class for which a settings file states one.

    Parameters
    ----------
    value
        What the file states: one pose for all classes, or a table with a pose for each class.
    entries
        Shapes of the data set.
    path
        The file, for an error.

    Raises
    ------
    ConfigurationError
        If a class, or a pose of it, is unknown.
    DatasetError
        If a pose is neither text nor a whole number.
    """
    poses_of = {}
    for subject, members in by_subject(entries).items():
        poses_of[subject] = [entry.pose for entry in members]
    table = value if isinstance(value, dict) else dict.fromkeys(poses_of, value)
    chosen = {}
    for subject, pose in table.items():
        check_known(f"class under canonical_pose in {path}", [subject], poses_of)
        is_name = isinstance(pose, int | str) and not isinstance(pose, bool)
        if not is_name:
            problem = f"{path}: the canonical pose of '{subject}' is {pose!r}"
            raise DatasetError(problem, "write a pose in quotes")
        check_known(f"pose of class '{subject}' in {path}", [str(pose)], poses_of[subject])
        chosen[subject] = str(pose)
    return chosen


def _by_name(
    value: Any, key: str, read: Callable[[Any], Value], shapes: ShapeSet, path: Path
) -> Callable[[Entry], Value | None]:
    """Return a function from a shape to what a settings file says for it; None for nothing.

    Parameters
    ----------
    value
        What the file says: one value for all shapes, or a table from class or shape to values.
    key
        Its name in the file.
    read
        What makes a value of it, or raises an error.
    shapes
        The data set.
    path
        The file.
    """
    if not isinstance(value, dict) or "direction" in value:
        value_of_all = read(value)
        return lambda _: value_of_all
    subjects = by_subject(shapes.shapes)
    known = {*subjects, *(entry.identifier for entry in shapes.shapes)}
    check_known(f"class under {key} in {path}", sorted(value.keys() - known), subjects)
    values = {name: read(text) for name, text in value.items()}
    return lambda entry: values.get(entry.identifier) or values.get(entry.subject)


def _metres(value: Any, path: Path) -> float:
    """Return the metres of a unit in a settings file."""
    if isinstance(value, str) and value in METRES:
        return METRES[value]
    return positive(value, f"unit (one of {', '.join(METRES)}, or metres)", path)


def _camera(value: Any, up: str, path: Path) -> Camera:
    """Return the camera that a settings file describes.

    Parameters
    ----------
    value
        The name of a view, or a table with ``direction`` and optionally ``up``.
    up
        Up axis of the meshes, ``"y"`` or ``"z"``, for a view by name or a table without ``up``.
    path
        The file, for an error.

    Raises
    ------
    ConfigurationError
        If the view or a key is unknown.
    DatasetError
        If the value does not describe a camera.
    """
    if isinstance(value, str):
        check_known(f"camera in {path}", [value], VIEWS)
        return _y_up(VIEWS[value]) if up == "y" else VIEWS[value]
    hint = "write the name of a view, or { direction = [x, y, z], up = [x, y, z] }"
    if not isinstance(value, dict) or "direction" not in value:
        raise DatasetError(f"{path}: {value!r} is no camera", hint)
    check_known(f"key of a camera in {path}", value, ("direction", "up"))
    default = (0.0, 1.0, 0.0) if up == "y" else (0.0, 0.0, 1.0)
    try:
        x, y, z = _three(value["direction"])
        a, b, c = _three(value.get("up", default))
        return Camera((float(x), float(y), float(z)), (float(a), float(b), float(c)))
    except (TypeError, ValueError, OverflowError, ConfigurationError) as error:
        raise DatasetError(f"{path}: {error}", hint) from error


def _three(direction: Any) -> Sequence[Any]:
    """Return a direction; raise ``ConfigurationError`` unless it is a list of three."""
    if isinstance(direction, list | tuple) and len(direction) == 3:
        return direction
    raise ConfigurationError(f"{direction!r:.60} is no direction of three numbers")


def _replaced_set(value: Any, path: Path) -> str:
    """Return the name of the set that shapes replace; raise ``DatasetError`` if it is no text."""
    if isinstance(value, str):
        return value
    problem = f"{path}: stand_in_for is {value!r:.60}"
    raise DatasetError(problem, "write the name of a data set in quotes, or remove it")


def _y_up(camera: Camera) -> Camera:
    """Convert a camera to shapes with y up that face +z; one with y up is returned unchanged."""
    if camera.up == (0.0, 1.0, 0.0):
        return camera
    x, y, z = camera.direction
    a, b, c = camera.up
    return Camera((x, z, -y), (a, c, -b))

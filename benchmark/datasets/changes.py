"""Changes of the shapes of a data set: ``animals[noise=3]``, ``FOLDER[holes=2][view-angle=4]``.

A change replaces functions of a :class:`~benchmark.api.datasets.ShapeSet`. All its levels draw the
same random numbers, so that they differ in the amount alone; those of ``jitter`` differ in the
numbers alone.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet, name_view
from benchmark.datasets import surface_changes as surface
from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh


@dataclass(frozen=True)
class Change:
    """A change of a mesh, of its camera, or of its depth sensor.

    Parameters
    ----------
    title
        Name in captions.
    unit
        Meaning of the amounts.
    amounts
        Amount at each level, from 1.
    of_mesh, of_camera, of_sensor, seen, of_set
        Function that changes the mesh or the camera, makes the sensor from the amount and a seed,
        returns what a camera sees of a mesh, or changes the data set.
    """

    title: str
    unit: str
    amounts: tuple[float, ...]
    of_mesh: Callable[[Mesh, float, surface.Random], Mesh] | None = None
    of_camera: Callable[[Camera, float, surface.Random], Camera] | None = None
    of_sensor: Callable[[float, int], DepthSensor] | None = None
    seen: Callable[[Mesh, Camera, float], Mesh] | None = None
    of_set: Callable[[ShapeSet, int], ShapeSet] | None = None


def seen_from_around(shapes: ShapeSet, count: int, *, own: bool = False) -> ShapeSet:
    """Return a data set with several views of each shape, from cameras around it.

    The cameras stand upright at equal angles; the first one stands half a step from the camera of
    the shape. All of them see as large a frame as that camera.

    Parameters
    ----------
    shapes
        A data set of complete surfaces.
    count
        Number of cameras around each shape.
    own
        Whether to add the view from the camera of the shape, as the last one.

    Returns
    -------
    ShapeSet
        The views of the first shape, then those of the second, and so on.

    Raises
    ------
    ConfigurationError
        If the data set holds views itself.
    """
    if "mesh" not in shapes.inputs:
        problem = f"{shapes.name} shows one side of each shape"
        raise ConfigurationError(problem, "choose a data set of complete surfaces")
    # Angles of the cameras from that of the shape, in radians.
    step = 2 * np.pi / count
    angles = [step * place for place in np.arange(count) + 0.5]
    if own:
        angles.append(0.0)
    # The views as shapes of the new set, and how each one is made.
    names: list[Entry] = []
    seen: dict[str, _Seen] = {}
    for entry in shapes.shapes:
        for number, angle in enumerate(angles):
            view = replace(entry, identifier=name_view(entry.identifier, number))
            names.append(view)
            seen[view.identifier] = _Seen(entry, angle)
    views = _Views(shapes, seen)
    return replace(
        shapes,
        shapes=tuple(names),
        load=views.load,
        key=views.key,
        camera=views.camera,
        sensor=views.sensor,
        code=views.code,
        files=views.files,
        framed=shapes,
    )


class _Seen(NamedTuple):
    """What one view shows.

    Parameters
    ----------
    shape
        The shape.
    angle
        Angle of the camera from the shape's own, around the upright axis, in radians.
    """

    shape: Entry
    angle: float


@dataclass(frozen=True)
class _Views:
    """Functions of a data set of views.

    Parameters
    ----------
    shapes
        The data set whose shapes are seen.
    seen
        The shape and the angle of each view, by the identifier of the view.
    """

    shapes: ShapeSet
    seen: Mapping[str, _Seen]

    def load(self, view: Entry) -> Mesh:
        """Return the mesh of the shape, which is the same in all its views."""
        return self.shapes.load(self.seen[view.identifier].shape)

    def key(self, view: Entry) -> str:
        """Return what determines the mesh of the shape."""
        return self.shapes.key(self.seen[view.identifier].shape)

    def camera(self, view: Entry) -> Camera:
        """Return the camera of the shape, turned by the angle of the view."""
        shape, angle = self.seen[view.identifier]
        return surface.turned_by(self.shapes.camera(shape), angle)

    def sensor(self, view: Entry) -> DepthSensor | None:
        """Return the depth sensor of the shape."""
        return self.shapes.sensor(self.seen[view.identifier].shape)

    def code(self, view: Entry) -> Sequence[str]:
        """Return the modules that make the mesh of the shape."""
        return self.shapes.code(self.seen[view.identifier].shape)

    def files(self, view: Entry) -> Sequence[Path]:
        """Return the files from which the mesh of the shape is read."""
        return self.shapes.files(self.seen[view.identifier].shape)


CHANGES = {
    "noise": Change(
        "vertex noise",
        "standard deviation / extent",
        (0.001, 0.002, 0.004, 0.008, 0.016),
        of_mesh=surface.noise,
    ),
    "holes": Change("holes", "number of holes", (2, 5, 10, 20, 40), of_mesh=surface.holes),
    "shortcuts": Change(
        "topological shortcuts", "number of glued pairs", (1, 2, 3, 4, 5), of_mesh=surface.shortcuts
    ),
    "resolution": Change(
        "resolution", "vertices", (20000, 8000, 1500, 1000, 500), of_mesh=surface.resolution
    ),
    "remeshing": Change(
        "other re-meshing",
        "length of an edge / extent",
        (0.006, 0.009, 0.013, 0.018, 0.024),
        of_mesh=surface.remeshing,
    ),
    "missing-parts": Change(
        "missing parts",
        "share of the area",
        (0.05, 0.1, 0.2, 0.3, 0.4),
        of_mesh=surface.missing_parts,
    ),
    "view-angle": Change(
        "view angle", "largest angle in degrees", (10, 20, 30, 45, 60), of_camera=surface.turned
    ),
    "depth-noise": Change(
        "depth noise and steps",
        "deviation and step / depth of the frame",
        (0.0005, 0.001, 0.002, 0.004, 0.008),
        of_sensor=lambda amount, seed: DepthSensor(amount, amount, seed),
    ),
    "perspective": Change(
        "perspective camera",
        "distance / extent",
        (3.0, 2.0, 1.5, 1.2, 1.0),
        seen=surface.seen_from_near,
    ),
    "cameras": Change("views around", "cameras", tuple(range(1, 37)), of_set=seen_from_around),
    "cameras-and-own": Change(
        "views around",
        "cameras and its own",
        tuple(range(1, 37)),
        of_set=partial(seen_from_around, own=True),
    ),
    "jitter": Change(
        "vertex noise of a millionth of the extent", "deviation", (1e-6,) * 9, of_mesh=surface.noise
    ),
}
"""Changes by name. Lengths are fractions of the longest side of the bounding box."""

#: Levels that the table of robustness shows.
STRENGTHS = (1, 2, 3, 4, 5)

_NAME = re.compile(r"(?P<base>.+)\[(?P<change>[a-z-]+)=(?P<level>[^\[\]=]*)\]", re.DOTALL)


def split_changes(name: str) -> tuple[str, list[tuple[str, int]]]:
    """Split ``"animals[noise=3][jitter=1]"`` into ``"animals"`` and its changes, in order.

    Raises
    ------
    ConfigurationError
        If a change has no such level.
    """
    changes: list[tuple[str, int]] = []
    last = _last_change(name)
    while last is not None:
        name, change, level = last
        changes.insert(0, (change, level))
        last = _last_change(name)
    return name, changes


def _last_change(name: str) -> tuple[str, str, int] | None:
    """Return the name before the last change, the change and its level; None without a change.

    The name of a folder may look like a change.
    """
    match = _NAME.fullmatch(name)
    if not match or match["change"] not in CHANGES or Path(name).is_dir():
        return None
    n_levels = len(CHANGES[match["change"]].amounts)
    if match["level"] not in map(str, range(1, n_levels + 1)):
        problem = f"'{match['change']}' has no level '{match['level']}'"
        raise ConfigurationError(problem, f"choose a whole number from 1 to {n_levels}")
    return match["base"], match["change"], int(match["level"])


def changed_name(base: str, change: str, level: int) -> str:
    """Return the name of a changed data set."""
    return f"{base}[{change}={level}]"


def with_change(shapes: ShapeSet, name: str, level: int) -> ShapeSet:
    """Apply a change to a data set.

    Raises
    ------
    ConfigurationError
        If the camera has depth noise already.
    """
    change = CHANGES[name]
    amount = change.amounts[level - 1]
    draw = f"{level}|" if name == "jitter" else ""
    of_surface = change.of_mesh or change.seen
    recipe = of_surface.__name__ if of_surface else name  # cameras and sensors are in the key

    def seed(entry: Entry) -> int:
        text = f"{name}|{draw}{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(text).digest()[:4], "big")

    def random(entry: Entry) -> surface.Random:
        return np.random.default_rng(seed(entry))

    result = replace(
        shapes,
        name=changed_name(shapes.name, name, level),
        title=f"{shapes.title}, {change.title}: {change.unit} {amount:g}",
        key=lambda entry: f"{shapes.key(entry)} {recipe} {amount!r} {seed(entry)}",
        code=lambda entry: (*shapes.code(entry), surface.__name__),
    )
    if of_set := change.of_set:
        views = of_set(shapes, level)
        return replace(
            views,
            name=result.name,
            title=result.title,
            code=lambda view: (*views.code(view), surface.__name__),
            inputs=("view",),
        )
    if of_mesh := change.of_mesh:

        def changed_mesh(entry: Entry) -> Mesh:
            return of_mesh(shapes.load(entry), amount, random(entry))

        return replace(result, load=changed_mesh)
    # What follows changes views alone.
    result = replace(result, inputs=tuple(input_ for input_ in shapes.inputs if input_ == "view"))
    if of_camera := change.of_camera:

        def changed_camera(entry: Entry) -> Camera:
            return of_camera(shapes.camera(entry), amount, random(entry))

        return replace(result, camera=changed_camera)
    if seen := change.seen:

        def seen_mesh(entry: Entry) -> Mesh:
            return seen(shapes.load(entry), shapes.camera(entry), amount)

        return replace(result, load=seen_mesh)
    of_sensor = change.of_sensor
    if of_sensor is None or (shapes.shapes and shapes.sensor(shapes.shapes[0])):
        problem = f"{shapes.name} has depth noise already"
        raise ConfigurationError(problem, "name one strength of depth-noise")
    return replace(result, sensor=lambda entry: of_sensor(amount, seed(entry)))

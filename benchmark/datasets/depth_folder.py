"""Folders of depth images: classes from sub-folders or file names, intrinsics and masks next to the images."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.base import Entry
from benchmark.datasets.files import FolderDataset, file_digest, is_there
from benchmark.datasets.settings import read_settings
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, FrameFiles, ObservedObject, Up, checked_up
from benchmark.depth.intrinsics import Intrinsics, intrinsics_of, parse_intrinsics
from benchmark.errors import BenchmarkError, DatasetError, ShapeError, UnreadableMesh
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh

__all__ = ["DepthFolder", "with_depth_settings"]

_KEYS = ("canonical_pose", "depth_scale", "half_width", "intrinsics", "up")


@dataclass(frozen=True)
class DepthFolder(FolderDataset):
    """Depth images on disk, one object each; see :class:`~benchmark.datasets.files.FolderDataset`.

    The mesh of an image is the visible surface, in metres: right, up, towards the camera.

    Parameters
    ----------
    half_width
        Half the width of the frame of the objects, in metres.
    intrinsics
        Intrinsics of all images; None searches for a file for each image.
    scale
        Units of the images per metre; None for 1000 (integers) or 1 (floats).
    up
        Up direction in the camera's frame (right, down, forward), used if no floor is detected.
    """

    half_width: float | None = HALF_WIDTH
    intrinsics: Intrinsics | None = None
    scale: float | None = None
    up: Up | None = None

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Supported inputs: views only, as a depth image shows one side of a shape."""
        return ("view",)

    def files(self, entry: Entry) -> FrameFiles:
        """Return the files of a frame."""
        if entry.path is None:
            raise UnreadableMesh(f"shape '{entry.identifier}' has no file", "give the entry a path")
        return FrameFiles(entry.path, self.intrinsics, None, self.scale, self.up, self.half_width or HALF_WIDTH)

    def load(self, entry: Entry) -> Mesh:
        """Return the surface of the object; raises ``DepthError`` if the frame is unreadable or shows no object."""
        return self.observed(entry).surface

    def observed(self, entry: Entry) -> ObservedObject:
        """Return the object in a frame; raises ``DepthError`` if the frame is unreadable or shows no object."""
        return self.files(entry).observe()

    def recipe(self, entry: Entry) -> str:
        """Return the digests of image, mask and intrinsics, and the settings."""
        files = self.files(entry)
        beside = {"mask": files.mask_file, "intrinsics": files.intrinsics_file}
        digests = [f"{what}:{file_digest(path)}" for what, path in beside.items() if path]
        settings = (self.intrinsics, self.scale, self.up, files.half_width)
        return " ".join(["sha256:" + file_digest(files.image), *digests, repr(settings)])

    def camera(self, entry: Entry) -> Camera:
        """Return the view of the depth camera, levelled."""
        return UPRIGHT


def with_depth_settings(dataset: DepthFolder, settings: Path) -> DepthFolder:
    """Apply the ``dataset.toml`` of a folder of depth images, if there is one.

    All keys are optional: ``intrinsics``, a file or fx, fy, cx, cy; ``depth_scale``, the units per metre; ``up``, the
    up direction in the camera's frame, [right, down, forward], used if no floor is detected; ``half_width``, half the
    width of the frame of the objects, in metres; ``canonical_pose``, a table from class to pose.

    Raises
    ------
    ConfigurationError
        If a key is unknown.
    DatasetError
        If the file is unreadable or a value is invalid.
    """
    if not is_there(settings):
        return dataset
    values = read_settings(settings, _KEYS, ", in a folder of depth images")
    try:
        return dataclasses.replace(dataset, **dict(_changes(values, settings.parent)))
    except (BenchmarkError, TypeError, ValueError) as error:
        problem = error.problem if isinstance(error, BenchmarkError) else str(error)
        hint = error.hint if isinstance(error, BenchmarkError) else "correct the value"
        raise DatasetError(f"{settings}: {problem}", hint) from error


def _changes(values: dict[str, Any], folder: Path) -> Iterator[tuple[str, Any]]:
    if "intrinsics" in values:
        intrinsics = values["intrinsics"]
        if isinstance(intrinsics, list):
            yield "intrinsics", parse_intrinsics(" ".join(map(str, intrinsics)))
        else:
            path = folder / str(intrinsics)
            yield "intrinsics", intrinsics_of(str(path if path.exists() or "," not in str(intrinsics) else intrinsics))
    for key, name in (("depth_scale", "scale"), ("half_width", "half_width")):
        if key in values:
            yield name, _positive(values[key], key)
    if "up" in values:
        if not isinstance(values["up"], list):
            raise TypeError(f"up is {values['up']!r}: write [right, down, forward], such as [0, -1, 0]")
        yield "up", tuple(checked_up([float(value) for value in values["up"]]).tolist())
    if "canonical_pose" in values:
        if not isinstance(values["canonical_pose"], dict):
            raise TypeError("canonical_pose is no table from class to pose")
        yield "canonical_poses", {subject: str(pose) for subject, pose in values["canonical_pose"].items()}


def _positive(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e9:
        raise ShapeError(f"{key} is {value!r}", "write a positive number")
    return float(value)

"""Folders of depth images, intrinsics and masks beside them, with a ``dataset.toml``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.settings import SETTINGS_FILE, canonical_poses, positive, read_settings
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, FrameFiles, ObservedObject, checked_up
from benchmark.depth.intrinsics import intrinsics_of
from benchmark.depth.reading import check_names, mask_folders_in
from benchmark.errors import BenchmarkError, DatasetError, DepthError, ShapeError
from benchmark.files import file_digest
from benchmark.geometry.mesh import Mesh

_KEYS = ("canonical_pose", "depth_scale", "half_width", "intrinsics", "up")
_WHERE = ", in a folder of depth images"


def depth_frame_set(name: str, folder: Path, entries: tuple[Entry, ...]) -> ShapeSet:
    """Return the data set of the depth images in a folder, each of one object.

    The mesh of a shape is its visible surface, with the axes right, up and towards the camera. The
    folder may have a ``dataset.toml`` with these keys:

    - ``intrinsics``, a file or fx, fy, cx, cy; by default, a file beside each image;
    - ``depth_scale``, the units of depth per metre;
    - ``up``, the up direction as [right, down, forward] of the camera, where no floor is detected;
    - ``half_width``, half the width of the frame of the objects, in metres;
    - ``canonical_pose``, a pose or a table from class to pose.

    Parameters
    ----------
    name
        Name of the set.
    folder
        Its folder, with ``dataset.toml``.
    entries
        The images.

    Raises
    ------
    ConfigurationError
        If a key, class or pose is unknown.
    DatasetError
        If ``dataset.toml`` is unreadable or a value is invalid, or if images of different folders
        have one mask.
    """
    path = folder / SETTINGS_FILE
    values = read_settings(path, _KEYS, _WHERE)
    settings = _camera(values, path)
    files = _files_of_entries(entries, settings)
    _check_masks(files, folder)
    frames = _Frames(files, settings)
    return ShapeSet(
        name=name,
        shapes=entries,
        load=frames.load,
        key=frames.key,
        files=frames.files_of,
        camera=lambda _: UPRIGHT,
        observe=frames.observe,
        half_width=settings["half_width"],
        inputs=("view",),
        folder=folder,
        canonical_poses=canonical_poses(values.get("canonical_pose", {}), entries, path),
        code=lambda _: (FrameFiles.__module__,),
    )


def _check_masks(files: Mapping[str, FrameFiles], folder: Path) -> None:
    """Raise ``DatasetError`` if images of different folders have one mask.

    A folder of masks beside folders of classes holds one ``1.png``, and each class may have an
    image of that name.

    Parameters
    ----------
    files
        The files of each shape by its identifier.
    folder
        Folder of the data set, relative to which masks are named.
    """
    shape_of_mask: dict[Path, str] = {}
    folders_of_images = {frame.image.parent for frame in files.values()}
    if not any(mask_folders_in(place.absolute().parent) for place in folders_of_images):
        return  # to look for the mask of each image takes long
    for shape, frame in files.items():
        try:
            mask = frame.mask_file
        except DepthError:  # the shape is refused when it is prepared
            continue
        if mask is None:
            continue
        first = shape_of_mask.setdefault(mask, shape)
        if files[first].image.parent != frame.image.parent:
            problem = f"{folder}: '{first}' and '{shape}' have one mask, {mask.name}"
            hint = (
                f"put the mask of each image into {mask.parent.name}/CLASS, or beside the image"
                " as NAME_mask.png"
            )
            raise DatasetError(problem, hint)


@dataclass(frozen=True)
class _Frames:
    """Functions of a data set of depth images.

    Parameters
    ----------
    files
        The image of each shape, and the files beside it, by the identifier of the shape.
    settings
        What ``dataset.toml`` says of the camera.
    """

    files: Mapping[str, FrameFiles]
    settings: Mapping[str, Any]

    def observe(self, entry: Entry) -> ObservedObject:
        """Return the object that the image of a shape shows."""
        return self.files[entry.identifier].observe()

    def load(self, entry: Entry) -> Mesh:
        """Return the visible surface of a shape."""
        return self.observe(entry).surface

    def key(self, entry: Entry) -> str:
        """Return a text that determines a shape: digests of its files, and settings of the set.

        Of the names, what decides whether and how an image is read: a wrong one can be corrected.
        """
        frame = self.files[entry.identifier]
        try:
            check_names(frame.image)
            parts = [frame.image.suffix.lower(), file_digest(frame.image)]
            if mask := frame.mask_file:
                parts.append(f"mask{mask.suffix.lower()}:{file_digest(mask)}")
            if intrinsics := frame.intrinsics_file:
                parts.append(f"intrinsics:{file_digest(intrinsics)}")
        except ShapeError as error:
            # The shape is refused later, when it is prepared: an unreadable file has no digest.
            return f"{entry.identifier}: {error}"
        return " ".join([*parts, repr(self.settings)])

    def files_of(self, entry: Entry) -> list[Path]:
        """Return the files that a shape is read from."""
        frame = self.files[entry.identifier]
        try:
            beside = [frame.mask_file, frame.intrinsics_file]
        except ShapeError:  # it is refused when it is prepared
            beside = []
        return [frame.image, *filter(None, beside)]


def frames_of(dataset: ShapeSet) -> dict[str, FrameFiles]:
    """Return the depth image of each shape of a set by its identifier, with the folder's camera.

    It is empty for a set of meshes. Errors are those of :func:`depth_frame_set`.
    """
    if dataset.observe is None or dataset.folder is None:
        return {}
    path = dataset.folder / SETTINGS_FILE
    settings = _camera(read_settings(path, _KEYS, _WHERE), path)
    return _files_of_entries(dataset.shapes, settings)


def _files_of_entries(
    entries: Iterable[Entry], settings: Mapping[str, Any]
) -> dict[str, FrameFiles]:
    """Return the depth image of each shape by its identifier, with the settings of its folder."""
    return {entry.identifier: FrameFiles(entry.path, **settings) for entry in entries if entry.path}


def _camera(values: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return what the settings of a data set say about its camera.

    Parameters
    ----------
    values
        Keys and values of ``dataset.toml``.
    path
        That file, relative to which files are named.

    Returns
    -------
    dict
        Keyword arguments of ``FrameFiles``: ``intrinsics``, ``scale``, ``up`` and ``half_width``.

    Raises
    ------
    DatasetError
        If a value is invalid.
    """
    camera: dict[str, Any] = {
        "intrinsics": None,
        "scale": None,
        "up": None,
        "half_width": HALF_WIDTH,
    }
    if "depth_scale" in values:
        camera["scale"] = positive(values["depth_scale"], "depth_scale", path)
    if "half_width" in values:
        camera["half_width"] = positive(values["half_width"], "half_width", path)
    try:
        if "intrinsics" in values:
            camera["intrinsics"] = intrinsics_of(str(values["intrinsics"]), path.parent)
        if "up" in values:
            camera["up"] = tuple(checked_up(values["up"]).tolist())
    except BenchmarkError as error:
        raise DatasetError(f"{path}: {error.located}", error.hint) from error
    return camera

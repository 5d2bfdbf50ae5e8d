"""Training pairs in memory, or, if they are too many, on disk."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from torch import Tensor

from benchmark.api.learning import Bodies, TrainingPair
from benchmark.errors import ShapeError, TrainingError
from benchmark.files import write_atomically, write_text
from benchmark.geometry.depth import DepthImage
from benchmark.locks import take_lock
from learned.images import DepthScale, checked_image, resampled

KEEPING_SECONDS = 60.0
"""Seconds between two notes of how many pairs are on disk, which is what an interruption costs."""

#: Errors of a file system that cannot reserve space.
_NOT_ON_THIS_DISK = (errno.EINVAL, errno.EOPNOTSUPP)

#: Depth that is 0 on disk: near it, where all bodies are, half precision is finest.
_MIDDLE = 0.5


class NoPairs(TrainingError):
    """None of the shapes has an image and a canonical one."""


@dataclass(frozen=True, eq=False)
class PairsInMemory:
    """All pairs of a training at its resolution.

    Parameters
    ----------
    names
        Names of the inputs, one per pair.
    images
        Depth, shape (n, 1, r, r).
    targets
        Depth and mask of the distinct targets, shape (t, 2, r, r).
    target_of
        Row of ``targets`` for each pair, shape (n,).
    scale
        Map that made the depths of ``targets``.
    """

    names: tuple[str, ...]
    images: Tensor
    targets: Tensor
    target_of: Tensor
    scale: DepthScale = field(default_factory=DepthScale)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return images and targets of some pairs."""
        return self.images[rows], self.targets[self.target_of[rows]]

    def to(self, device: torch.device) -> PairsInMemory:
        """Return a copy on a device."""
        return replace(
            self,
            images=self.images.to(device),
            targets=self.targets.to(device),
            target_of=self.target_of.to(device),
        )

    def scaled(self, scale: DepthScale) -> PairsInMemory:
        """Return the pairs with the depths of targets mapped."""
        return replace(self, targets=scale.apply(self.targets), scale=scale)

    def stretched(self) -> PairsInMemory:
        """Return the pairs with the depths of their targets stretched to the range from .1 to .9.

        The scale comes from the least, the largest and the mean depth of all targets.
        """
        return self.scaled(DepthScale.of(self.targets))

    def digest(self) -> str:
        """Return the digest of names and pixels, 64 hexadecimal digits."""
        digest = hashlib.sha256("\0".join(self.names).encode())
        for tensor in (self.images, self.targets, self.target_of):
            digest.update(tensor.numpy().data)
        return digest.hexdigest()


def gather(
    pairs: Iterable[TrainingPair], n_pairs: int, resolution: int, crop: bool = False
) -> PairsInMemory:
    """Load all pairs into memory, at the resolution of the network.

    A target that several images share is kept once.

    Parameters
    ----------
    pairs
        Images and targets.
    n_pairs
        Largest number of pairs, for which memory is reserved.
    resolution
        Pixels per side.
    crop
        Whether images and targets are cropped to the body.

    Raises
    ------
    NoPairs
        If there is no pair.
    InvalidMesh, UnsupportedShape
        If an image cannot be read; see :func:`learned.images.checked_image` and
        :func:`learned.images.resampled`.
    """
    images = np.empty((n_pairs, 1, resolution, resolution), dtype=np.float32)
    names: list[str] = []
    targets: list[DepthImage] = []
    row_of: dict[str, int] = {}  # index of each target by its identifier
    target_of: list[int] = []  # index of the target of each pair
    for pair in pairs:
        row = row_of.setdefault(pair.target_identifier, len(targets))
        try:
            images[len(names)] = resampled(checked_image(pair.image), resolution, crop=crop)[:1]
            if row == len(targets):  # the target is new
                targets.append(resampled(checked_image(pair.target), resolution, crop=crop))
        except ShapeError as error:
            raise type(error)(f"{pair.identifier}: {error.problem}", error.hint) from error
        names.append(pair.identifier)
        target_of.append(row)
    if not names:
        raise NoPairs("there is no pair to train on", "check the data set with 'data check'")
    return PairsInMemory(
        names=tuple(names),
        images=torch.from_numpy(images[: len(names)]),
        targets=torch.from_numpy(np.stack(targets)),
        target_of=torch.tensor(target_of),
    )


@dataclass(frozen=True, eq=False)
class PairsOnDisk:
    """Pairs in a memory-mapped file of half precision; each target is one of the images.

    Parameters
    ----------
    names
        Names of the images, one per pair.
    depths
        Depth of each image minus a half, shape (n, r, r), float16; -1/2 is the background.
    target_of
        Row of ``depths`` that is the target of each pair, shape (n,).
    device
        Device of the pairs that are read.
    scale
        Map of the depths of targets.
    """

    names: tuple[str, ...]
    depths: np.memmap[Any, np.dtype[np.float16]]
    target_of: Tensor
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))
    scale: DepthScale = field(default_factory=DepthScale)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return images and targets of some pairs."""
        rows = rows.cpu()
        image, _ = self._read(rows).split(1, dim=1)
        target = self.scale.apply(self._read(self.target_of[rows]))
        return image.to(self.device), target.to(self.device)

    def _read(self, rows: Tensor) -> Tensor:
        """Return depth and mask of some images, shape (n, 2, r, r)."""
        depth = torch.from_numpy(self.depths[rows.numpy()].astype(np.float32) + _MIDDLE)
        return torch.stack([depth, (depth > 0).float()], dim=1)

    def to(self, device: torch.device) -> PairsOnDisk:
        """Return the pairs, to be read to a device."""
        return replace(self, device=device)

    def scaled(self, scale: DepthScale) -> PairsOnDisk:
        """Return the pairs with the depths of targets mapped."""
        return replace(self, scale=scale)

    def stretched(self) -> PairsOnDisk:
        """Return the pairs with the depths of their targets stretched to the range from .1 to .9.

        The scale comes from the least, the largest and the mean depth of all targets, without their
        background. Stored depths are relative to the middle of the frame, 1/2.
        """
        total = 0
        count = 0
        least = math.inf
        largest = -math.inf
        for row in self.target_of.unique().tolist():
            image = self.depths[row]
            depths = image[image > -_MIDDLE].astype(np.float64)
            # Summed as integers, in units of 2**-24, so that the order does not matter.
            total += int((depths * 2**24).astype(np.int64).sum())
            count += len(depths)
            least = min(least, float(depths.min()))
            largest = max(largest, float(depths.max()))
        mean = total / count / 2**24
        return self.scaled(DepthScale.between(least + _MIDDLE, largest + _MIDDLE, mean + _MIDDLE))

    def digest(self) -> str:
        """Return the digest of names and pixels, 64 hexadecimal digits."""
        digest = hashlib.sha256("\0".join(self.names).encode())
        for first in range(0, len(self), 1000):
            digest.update(np.ascontiguousarray(self.depths[first : first + 1000]).data)
        digest.update(self.target_of.numpy().data)
        return digest.hexdigest()


AnyPairs = PairsInMemory | PairsOnDisk


def keep(
    bodies: Bodies, resolution: int, crop: bool, folder: Path, say: Callable[[str], None]
) -> PairsOnDisk:
    """Render the images of many bodies to a file on disk, and return them as training pairs.

    If the file exists, it is used; if an earlier call was interrupted, this one goes on. If another
    process makes it, this one waits.

    Parameters
    ----------
    bodies
        The bodies and their images. The first image of a body is the target of all its images.
    resolution
        Pixels per side.
    crop
        Whether the images are cropped to the body.
    folder
        Folder of the file.
    say
        Called with a line of progress every minute.

    Raises
    ------
    TrainingError
        If the folder holds the pairs of other bodies or of other code.
    """
    recipe = {"recipe": bodies.recipe, "resolution": resolution, "crop": crop}
    folder.mkdir(parents=True, exist_ok=True)
    announce = partial(say, f"waiting for another training, which makes the images in {folder}")
    with (folder / "lock").open("a") as lock:  # trainings with several seeds share the images
        take_lock(lock.fileno(), before_waiting=announce)
        depths = _made(bodies, recipe, folder, say)
    # The target of each image is the first one of its body.
    rows = torch.arange(len(depths))
    return PairsOnDisk(bodies.identifiers(), depths, rows // bodies.n_images * bodies.n_images)


def _made(
    bodies: Bodies, recipe: Mapping[str, Any], folder: Path, say: Callable[[str], None]
) -> np.memmap[Any, np.dtype[np.float16]]:
    """Return the depths of all images, after those that are missing are made.

    Parameters
    ----------
    bodies
        The bodies and their images.
    recipe
        What makes the images: the digest of the bodies, and ``resolution`` and ``crop`` as in
        :func:`keep`.
    folder
        Folder of the file.
    say
        Called with a line of progress every minute.
    """
    resolution = recipe["resolution"]
    note = folder / "progress.json"
    path = folder / "depths.npy"
    finished = _finished_bodies(note, recipe)
    n_images = bodies.n_images
    shape = (len(bodies.names) * n_images, resolution, resolution)
    if not finished or not _holds(path, shape):
        finished = 0
        note.unlink(missing_ok=True)  # it counts images that were deleted
        write_atomically(path, lambda file: _write_empty(file, shape))
    depths: np.memmap[Any, np.dtype[np.float16]] = np.lib.format.open_memmap(path, mode="r+")

    def note_finished(count: int) -> None:
        """Note that the images of the first bodies are in the file."""
        depths.flush()
        write_text(note, json.dumps({**recipe, "bodies": count}))

    # Images go straight to the file. Once a minute, the number of finished bodies is noted.
    noted = time.perf_counter()
    for number in range(finished, len(bodies.names)):
        for place, image in enumerate(bodies.images(number)):
            depth, _ = resampled(checked_image(image), resolution, crop=recipe["crop"])
            depths[number * n_images + place] = depth - _MIDDLE
        if time.perf_counter() - noted > KEEPING_SECONDS:
            noted = time.perf_counter()
            note_finished(number + 1)
            say(f"images of {number + 1} of {len(bodies.names)} bodies are made")
    if finished < len(bodies.names):
        note_finished(len(bodies.names))
    return depths


def _holds(path: Path, shape: tuple[int, ...]) -> bool:
    """Return whether a file is a whole array of depths of this shape."""
    try:
        depths = np.lib.format.open_memmap(path, mode="r")
    except (FileNotFoundError, EOFError, ValueError):  # the last for one that was cut short
        return False
    return depths.shape == shape and depths.dtype == np.float16


def _finished_bodies(note: Path, recipe: Mapping[str, Any]) -> int:
    """Return how many bodies are on disk, as a note says; 0 without one.

    Raises
    ------
    TrainingError
        If they are of another recipe.
    """
    if not note.is_file():
        return 0
    stored = json.loads(note.read_text(encoding="utf-8"))
    finished = int(stored.pop("bodies"))
    if stored != recipe:
        problem = f"the pairs in {note.parent} were made by other code"
        raise TrainingError(problem, "delete that folder to make them again")
    return finished


def _write_empty(file: BinaryIO, shape: tuple[int, ...]) -> None:
    """Write an array of zeros."""
    header = {"descr": np.dtype(np.float16).str, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    size = file.tell() + math.prod(shape) * np.dtype(np.float16).itemsize
    file.truncate(size)
    _reserve(file, size)


def _reserve(file: BinaryIO, size: int) -> None:
    """Take the space of a file at once, where the system can.

    A process that fills a mapped file dies without a word when the disk is full.
    """
    if not hasattr(os, "posix_fallocate"):  # as on macOS
        return
    try:
        os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if error.errno not in _NOT_ON_THIS_DISK:
            raise

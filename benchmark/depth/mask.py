"""Masks: which pixels of a depth image show the object."""

from __future__ import annotations

import glob
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.errors import InvalidMask
from benchmark.depth.reading import LARGEST_SIDE

Mask = NDArray[np.bool_]

MASK_FOLDERS = ("mask", "masks")
"""Names of folders of masks."""

#: What ends the name of an image, in place of which a mask's name may say "mask".
_DEPTH = ("depth", "Depth", "DEPTH")


def read_mask(path: Path) -> Mask:
    """Read a mask: what is not black, or of an image with an alpha channel not transparent either, is the object.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    InvalidMask
        If it cannot be read, or is empty.
    """
    from PIL import Image

    try:
        with Image.open(path) as image:
            if max(image.size) > LARGEST_SIDE:
                raise InvalidMask(f"{path} has {image.size[0]} x {image.size[1]} pixels", "pass a mask of the image")
            values = np.array(image.convert("RGBA") if image.mode in ("P", "PA", "LA", "RGBa") else image)
    except InvalidMask:
        raise
    except Exception as error:
        what = f"{path} is no readable mask: {' '.join(str(error).split())}"
        raise InvalidMask(f"{what:.300}", "pass a PNG that is white on the object and black elsewhere") from error
    if values.ndim == 2:
        return np.asarray(values > 0)
    bright = values[..., :3].any(axis=-1)
    return np.asarray(bright & (values[..., 3] > 0) if values.shape[-1] == 4 else bright)


def checked_mask(mask: NDArray[Any], seen: Mask) -> Mask:
    """Return a mask of the seen pixels.

    Parameters
    ----------
    mask
        Shape (h, w); what is not zero is the object.
    seen
        Pixels with a depth, shape (h, w).

    Raises
    ------
    InvalidMask
        If it has another size, or no pixel of it has a depth.
    """
    mask = np.asarray(mask != 0)
    if mask.shape != seen.shape:
        sizes = [" x ".join(map(str, each.shape[::-1])) for each in (mask, seen)]
        raise InvalidMask(f"the mask has {sizes[0]} pixels, the image {sizes[1]}", "pass a mask of the depth image")
    if not mask.any():
        raise InvalidMask("the mask is empty", "let it be white on the object")
    if not (mask & seen).any():
        raise InvalidMask("no pixel of the mask has a depth", "check that mask and image belong to one frame")
    return np.asarray(mask & seen)


def find_mask(image: Path) -> Path | None:
    """Return the mask of an image by its usual names: beside it, or in a folder ``mask`` or ``masks``; else None."""
    return next((path for path in _candidates(image) if path.is_file()), None)


def _candidates(image: Path) -> Iterator[Path]:
    shorter = (image.stem.removesuffix(word).rstrip("._-") for word in _DEPTH if image.stem.endswith(word))
    stems = [image.stem, *filter(None, shorter)]
    for stem in stems:
        for mark in (".", "_", "-"):
            yield image.with_name(f"{stem}{mark}mask.png")
    for folder in (image.parent, image.parent.parent):
        for name in MASK_FOLDERS:
            for stem in stems:
                yield folder / name / f"{stem}.png"
                yield folder / name / f"{stem}_mask.png"
                named = sorted((folder / name).glob(f"{glob.escape(stem)}_*.png"))
                yield from named if len(named) == 1 else []  # of several objects nobody says which is meant

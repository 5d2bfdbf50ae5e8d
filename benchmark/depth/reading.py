"""Depth images and masks in files: Pillow reads PNG, TIFF, PGM and PFM, numpy the rest."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import DepthError
from benchmark.geometry.io import named_errors

if TYPE_CHECKING:
    from PIL import Image

Depths = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXTENSIONS = (".png", ".tif", ".tiff", ".pgm", ".pfm", ".npy", ".npz")
"""Extensions of depth images, in lower case."""

LARGEST_SIDE = 4096
"""Maximum pixels per side. Depth cameras have about a million pixels; larger images could exhaust the memory."""

DEFAULT_SCALE = 1000.0
"""Units per metre of an integer image; most cameras use millimetres."""

NEAREST, FARTHEST = 0.05, 200.0
"""Bounds of a plausible median depth in metres; outside them, the scale is wrong."""

#: Values that programs write for pixels without a reading, if nothing is farther; in floats also a thousandth of them.
_BACKGROUND = (9_999, 10_000, 32_767, 65_504, 65_535)

#: No reading in any unit: smaller than the 1e10 of Blender, the largest float, and 2**31 - 1.
_NO_READING = 1e9

#: Share of the pixels from which one value beyond :data:`FARTHEST` is a background.
_FAR_PLANE = 0.01

#: Words for inverse depth in names of files, folders and arrays.
_INVERSE = re.compile("(?<![a-z])disp(arity|arities|s)?(?![a-z])|inv(erse)?[-_ ]?depth|idepth|midas", re.IGNORECASE)

#: Names of arrays beside depths that say what these mean, or where they are.
_UNREAD = re.compile("scale|unit|offset|crop|intrinsic|camera|mask|^k$", re.IGNORECASE)

_END_OF_PNG = b"IEND\xaeB`\x82"

FEWEST_SEEN = 200
"""Minimum number of pixels with a depth, as the projection requires of a shape."""

MASK_FOLDERS = ("mask", "masks")
"""Names of mask folders."""

#: The word "mask" in a file name, as in ``0_mask``, ``masks3`` and ``depthMask``, but not in ``unmasked``.
_MASK = re.compile("(?<![A-Za-z])(mask|MASK)(s|S)?(?![A-Za-z])|Masks?(?![a-z])")

#: Maximum value of a portable grey map, which Pillow stretches to 16 bits.
_MAXIMUM = re.compile(rb"P[25](?:\s+|#[^\n]*\n)+\d+(?:\s+|#[^\n]*\n)+\d+(?:\s+|#[^\n]*\n)+(\d{1,5})\s")


def read_values(path: Path) -> NDArray[Any]:
    """Read a depth image in its own unit; :func:`in_metres` converts it.

    Parameters
    ----------
    path
        A file with one of the :data:`EXTENSIONS`; an ``.npz`` holds one array, or one named ``depth``.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), integers or floats.

    Raises
    ------
    DepthError
        If the file is missing, damaged, too large, or contains no depth.
    """
    suffix = path.suffix.lower()
    with named_errors(path, f"{suffix[1:]} file", DepthError, "export the image again"):
        if suffix not in EXTENSIONS:
            raise DepthError(f"unknown extension '{suffix}'", f"convert it to one of {', '.join(EXTENSIONS)}")
        if named := next((name for name in (path.stem, path.parent.name) if _INVERSE.search(name)), None):
            _refuse_inverse(named)
        return _array(path) if suffix in (".npy", ".npz") else _pixels(path)


def _refuse_inverse(name: str) -> NoReturn:
    raise DepthError(f"'{name}' names disparities or inverse depths", "convert them to depths, or rename it")


def in_metres(values: NDArray[Any], scale: float | None = None) -> Depths:
    """Return depths in metres, with 0 for missing depth.

    Parameters
    ----------
    values
        Shape (h, w) or (h, w, 1), integers or floats; see :func:`readings` for values that mark missing depth.
    scale
        Units per metre; None for 1000 (integers) or 1 (floats).

    Raises
    ------
    DepthError
        If the image has several channels, too few pixels with a depth, a constant depth, an implausible scale, or
        without a scale depths that end at 1 (floats) or 255 (integers).
    """
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise DepthError(f"invalid depth scale {scale}", "pass a positive number of units per metre")
    depth = readings(values)
    is_float = np.asarray(values).dtype.kind == "f"
    units = scale or (1.0 if is_float else DEFAULT_SCALE)
    seen = depth[depth > 0]
    far = FARTHEST * units
    if (seen > far).any() and np.count_nonzero(seen == seen.max()) > _FAR_PLANE * depth.size:
        seen = seen[seen < seen.max()]
    if len(seen) < FEWEST_SEEN:
        hint = "check that it is the depth image, and that 0, NaN and infinity mean that nothing was seen"
        raise DepthError(f"too few pixels have a depth: {len(seen)} of {depth.size}, fewer than {FEWEST_SEEN}", hint)
    median = float(np.median(seen)) / units
    if not NEAREST <= median <= FARTHEST:
        problem = f"the median depth is {median:g} m with {units:g} units per metre"
        raise DepthError(problem, "pass the camera's --depth-scale: 1000 for millimetres, 5000 for TUM, 1 for metres")
    if seen.min() == seen.max():
        raise DepthError(f"all {len(seen)} pixels lie at {median:g} m", "pass a depth image, not a mask")
    if scale is None and seen.max() == (1 if is_float else 255):
        problem = f"the depths end at {seen.max():g}, as if they were scaled to this range"
        raise DepthError(problem, f"export measured depths, or pass --depth-scale {units:g} if they are depths")
    return np.asarray(np.where(depth > far, 0, depth / units))


def readings(values: NDArray[Any]) -> Depths:
    """Return the values of a depth image as floats, with 0 for pixels without a reading.

    Parameters
    ----------
    values
        Shape (h, w) or (h, w, 1), integers or floats. Missing are 0, negative, NaN and infinite values, 1e9 and more,
        the largest value of the type, and 65535, 65504, 32767, 10000 and 9999 if nothing is farther.

    Raises
    ------
    DepthError
        If it is no image of one channel.
    """
    values = np.asarray(values)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2 or values.dtype.kind not in "iuf":
        problem = f"an array of {values.dtype} and shape {values.shape} is no depth image"
        raise DepthError(problem, "pass one channel of integers or floats, shape (height, width)")
    _check_size(values.shape[1], values.shape[0])
    is_float = values.dtype.kind == "f"
    largest = np.finfo(values.dtype).max if is_float else np.iinfo(values.dtype).max
    raw = values.astype(np.float64)
    with np.errstate(invalid="ignore"):
        raw[~((raw > 0) & (raw < _NO_READING)) | (values == largest)] = 0
    while (top := raw.max(initial=0)) in _BACKGROUND or (is_float and round(1000 * top, 1) in _BACKGROUND):
        raw[raw == top] = 0
    return raw


def _check_size(width: int, height: int) -> None:
    if max(width, height) > LARGEST_SIDE:
        problem = f"{width} x {height} pixels are more than {LARGEST_SIDE} per side"
        raise DepthError(problem, "reduce it, and its intrinsics alike")


def _pixels(path: Path) -> NDArray[Any]:
    with _opened(path) as image:
        _check_size(*image.size)
        if image.info.get("scale", 1) != 1:  # of a PFM
            raise DepthError(f"its scale factor is {image.info['scale']:g}, not 1", "multiply the depths by it")
        if image.mode != "F" and not image.mode.startswith("I"):
            kind = "8 bits" if image.mode in ("L", "1", "P") else f"colours ({image.mode})"
            raise DepthError(f"the image holds {kind}, no depth", "export depth with 16 bits per pixel and one channel")
        values = np.array(image)
        if image.mode == "I" and image.format in ("PNG", "PPM"):  # 16 bits in 32
            head = _MAXIMUM.match(path.open("rb").read(1000))
            values = np.round(values * (int(head[1]) / 65535 if head else 1)).astype(np.uint16)
        return values


def _opened(path: Path) -> Image.Image:
    """Open an image of one frame; a PNG with wrong checksums or without its end is damaged."""
    from PIL import Image  # lazy: most verbs read no image

    with Image.open(path) as image:
        image.verify()
        if image.format == "PNG" and _END_OF_PNG not in path.read_bytes():
            raise DepthError("the file is truncated", "export the image again")
    image = Image.open(path)
    if getattr(image, "n_frames", 1) != 1:
        raise DepthError(f"it holds {getattr(image, 'n_frames', 1)} images", "write one image per file")
    return image


def _array(path: Path) -> NDArray[Any]:
    """Return an array, whose size is checked before it is read: a small file can declare any."""
    loaded = np.load(path, mmap_mode="r", allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return loaded
    with loaded as archive:
        names = archive.files
        if unread := [name for name in names if _UNREAD.search(name)]:
            hint = "apply it to the depths, or write the camera or the mask beside the image, and leave it out"
            raise DepthError(f"'{unread[0]}' of the archive is not read", hint)
        if "depth" not in names and len(names) != 1:
            listed = ", ".join(names[:6]) or "nothing"
            raise DepthError(f"the archive holds {listed}", "name the array of depths 'depth'")
        name = "depth" if "depth" in names else names[0]
        if _INVERSE.search(name):
            _refuse_inverse(name)
        if archive.zip.getinfo(f"{name}.npy").file_size > 8 * LARGEST_SIDE**2 + 1000:
            raise DepthError(f"the array has more than {LARGEST_SIDE} pixels per side", "reduce it")
        return np.asarray(archive[name])


def is_depth_file(path: Path) -> bool:
    """Return whether a file may be a depth image: integers or floats by its header, and not named as a mask."""
    suffix = path.suffix.lower()
    if suffix not in EXTENSIONS or _MASK.search(path.stem):
        return False
    if suffix in (".npy", ".npz"):
        return True
    from PIL import Image

    try:
        with Image.open(path) as image:
            return bool(image.mode == "F" or image.mode.startswith("I"))
    except Exception:  # a damaged image is a shape that is lost, not one that is ignored
        return True


def read_mask(path: Path) -> Mask:
    """Read a mask; the object is every pixel that is neither black nor fully transparent.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    DepthError
        If the file is unreadable.
    """
    hint = "pass a PNG that is white on the object and black elsewhere"
    with named_errors(path, "mask", DepthError, hint), _opened(path) as image:
        _check_size(*image.size)
        values = np.array(image.convert("RGBA") if image.mode in ("P", "PA", "LA", "RGBa") else image)
    if values.ndim == 2:
        return np.asarray(values > 0)
    bright = values[..., :3].any(axis=-1)
    return np.asarray(bright & (values[..., 3] > 0) if values.shape[-1] == 4 else bright)


def checked_mask(mask: NDArray[Any], seen: Mask) -> Mask:
    """Return a mask, nonzero on the object, restricted to pixels with a depth.

    Raises
    ------
    DepthError
        If the mask is empty, has another size, or contains no pixel with a depth.
    """
    mask = np.asarray(mask != 0)
    if mask.shape != seen.shape:
        sizes = [" x ".join(map(str, image.shape[::-1])) for image in (mask, seen)]
        raise DepthError(f"the mask has {sizes[0]} pixels, the image {sizes[1]}", "pass a mask of the depth image")
    if not mask.any():
        raise DepthError("the mask is empty", "let it be white on the object")
    if not (mask & seen).any():
        raise DepthError("no pixel of the mask has a depth", "check that mask and image belong to one frame")
    return np.asarray(mask & seen)


def find_mask(image: Path) -> Path | None:
    """Return the mask of an image by its usual names, next to it or in a folder ``mask`` or ``masks``; else None."""
    return next((path for path in _candidates(image) if path.is_file()), None)


def _candidates(image: Path) -> Iterator[Path]:
    shorter = re.sub(r"[._-]*(depth|Depth|DEPTH)$", "", image.stem)
    stems = dict.fromkeys((image.stem, shorter or image.stem))
    yield from (image.with_name(f"{stem}{mark}mask.png") for stem in stems for mark in "._-")
    for folder in (image.parent, image.parent.parent):
        for name in MASK_FOLDERS:
            for stem in stems:
                yield folder / name / f"{stem}.png"
                yield folder / name / f"{stem}_mask.png"
                named = sorted((folder / name).glob(f"{glob.escape(stem)}_*.png"))
                yield from named if len(named) == 1 else []  # several masks are ambiguous

"""Read depth images (16-bit PNG and TIFF, NPY, NPZ, PFM) and masks."""

from __future__ import annotations

import glob
import io
import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from benchmark.depth.errors import InvalidDepth, InvalidMask, UnreadableDepth

Depths = NDArray[np.float64]

LARGEST_SIDE = 4096
"""Maximum pixels per side. Depth cameras have about a million pixels; larger images could exhaust the memory."""

DEFAULT_SCALE = 1000.0
"""Units per metre of an integer image; most cameras use millimetres."""

NEAREST, FARTHEST = 0.05, 200.0
"""Bounds of a plausible median depth in metres; outside them, the scale is wrong."""

FEWEST_SEEN = 200
"""Minimum number of pixels with a depth, as the projection requires of a shape."""

_MEDIAN_OF = 10_000
"""Approximate number of pixels for the median depth."""

#: Pillow modes suitable for depth: 16-bit or 32-bit integers and floats.
_MODES = frozenset({"I", "I;16", "I;16L", "I;16B", "I;16N", "F"})

#: Maximum header size of an NPY file, in bytes.
_LARGEST_HEADER = 10_000


def read_depth(path: Path, scale: float | None = None) -> Depths:
    """Read a depth image.

    Parameters
    ----------
    path
        A ``.png``, ``.tif``, ``.tiff``, ``.npy``, ``.npz`` (with one array, or one named ``depth``) or ``.pfm`` file.
    scale
        Units per metre; None for 1000 (integers) or 1 (floats).

    Returns
    -------
    numpy.ndarray
        Shape (h, w), metres along the optical axis; 0 for missing depth.

    Raises
    ------
    UnreadableDepth
        If the file is missing, damaged, too large, or contains no depth.
    InvalidDepth
        As in :func:`in_metres`.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise UnreadableDepth(f"{path}: unknown extension '{suffix}'", f"convert it to one of {', '.join(READERS)}")
    try:
        values = READERS[suffix](path)
    except UnreadableDepth as error:
        raise UnreadableDepth(f"{path}: {error.problem}", error.hint) from error
    except OSError as error:
        what = error.strerror or f"not a readable {suffix[1:]} file: {error}"
        raise UnreadableDepth(f"{path}: {what}", "check the path, or export the image again") from error
    except Exception as error:  # any reader failure on a damaged file excludes this file only
        what = f"not a readable {suffix[1:]} file: {' '.join(str(error).split()) or type(error).__name__}"
        raise UnreadableDepth(f"{path}: {what:.300}", "export the image again") from error
    try:
        return in_metres(values, scale)
    except InvalidDepth as error:
        raise InvalidDepth(f"{path}: {error.problem}", error.hint) from error


def in_metres(values: NDArray[Any], scale: float | None = None) -> Depths:
    """Return depths in metres, with 0 for missing depth (0, negative, NaN or infinite values).

    Parameters
    ----------
    values
        Shape (h, w) or (h, w, 1), integers or floats.
    scale
        Units per metre; None for 1000 (integers) or 1 (floats).

    Raises
    ------
    InvalidDepth
        If the image has several channels, too few pixels with a depth, a constant depth, or an implausible scale.
    """
    values = np.asarray(values)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2 or values.dtype.kind not in "iuf":
        raise InvalidDepth(
            f"an array of {values.dtype} and shape {values.shape} is no depth image",
            "pass one channel of integers or floats, shape (height, width)",
        )
    _check_size(values.shape[1], values.shape[0])
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise InvalidDepth(f"a depth scale of {scale} is none", "pass a positive number of units per metre")
    units = scale or (1.0 if values.dtype.kind == "f" else DEFAULT_SCALE)
    with np.errstate(over="ignore", invalid="ignore"):
        depth = values.astype(np.float64) / units
        depth[~(np.isfinite(depth) & (depth > 0))] = 0
    seen = depth[depth > 0]
    if len(seen) < FEWEST_SEEN:
        raise InvalidDepth(
            f"{len(seen)} of {depth.size} pixels have a depth, fewer than {FEWEST_SEEN}",
            "check that it is the depth image, and that 0, NaN and infinity mean that nothing was seen",
        )
    median = float(np.median(seen[:: max(1, len(seen) // _MEDIAN_OF)]))
    if not NEAREST <= median <= FARTHEST:
        raise InvalidDepth(
            f"the median depth is {median:g} m with {units:g} units per metre",
            "pass the camera's --depth-scale: 1000 for millimetres, 5000 for TUM, 1 for metres",
        )
    if seen.min() == seen.max():
        raise InvalidDepth(f"all {len(seen)} pixels lie at {median:g} m", "pass a depth image, not a mask")
    return depth


def _check_size(width: int, height: int) -> None:
    if max(width, height) > LARGEST_SIDE:
        raise UnreadableDepth(
            f"{width} x {height} pixels are more than {LARGEST_SIDE} per side", "reduce it, and its intrinsics alike"
        )


def _read_image(path: Path) -> NDArray[Any]:
    from PIL import Image

    try:
        image = Image.open(path)
    except Image.DecompressionBombError as error:
        raise UnreadableDepth("it claims more pixels than any depth camera has", "export the image again") from error
    with image:
        _check_size(*image.size)
        if image.mode not in _MODES:
            kind = "8 bits" if image.mode in ("L", "1", "P") else f"colours ({image.mode})"
            raise UnreadableDepth(
                f"the image holds {kind}, no depth", "export depth with 16 bits per pixel and one channel"
            )
        return np.array(image)


def _read_npy(path: Path) -> NDArray[Any]:
    with path.open("rb") as stream:
        return _read_array(stream)


def _read_npz(path: Path) -> NDArray[Any]:
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(".npy")]
        chosen = "depth.npy" if "depth.npy" in names else names[0] if len(names) == 1 else ""
        if not chosen:
            listed = ", ".join(name.removesuffix(".npy") for name in names[:6]) or "nothing"
            raise UnreadableDepth(f"the archive holds {listed}", "name the array of depths 'depth'")
        with archive.open(chosen) as stream:
            return _read_array(stream)


def _read_array(stream: Any) -> NDArray[Any]:
    """Read an array after checking its header, since a small file can declare any size."""
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(stream, max_header_size=_LARGEST_HEADER)
    if dtype.kind not in "iuf" or len(shape) not in (2, 3):
        raise UnreadableDepth(f"an array of {dtype} and shape {shape} is no depth image", "save shape (height, width)")
    _check_size(shape[1], shape[0])
    if len(shape) == 3 and shape[2] != 1:
        raise UnreadableDepth(f"an array of shape {shape} has {shape[2]} channels", "save shape (height, width)")
    stream.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False, max_header_size=_LARGEST_HEADER)
    return array


def _read_pfm(path: Path) -> NDArray[Any]:
    with path.open("rb") as stream:
        return _parse_pfm(stream)


def _parse_pfm(stream: BinaryIO) -> NDArray[Any]:
    """Read a portable float map: rows from bottom to top; a negative scale means little endian."""
    head = re.match(rb"(P[fF])\s+(\d{1,6})\s+(\d{1,6})\s+(-?[\d.eE+-]+)\s", stream.read(100))
    if head is None or head[1] != b"Pf":
        raise UnreadableDepth("it is no portable float map of one channel", "let it begin with 'Pf'")
    width, height = int(head[2]), int(head[3])
    _check_size(width, height)
    stream.seek(head.end())
    data = io.BytesIO(stream.read(4 * width * height)).getbuffer()
    if len(data) < 4 * width * height:
        raise UnreadableDepth(f"it ends after {len(data) // 4} of {width * height} pixels", "export the image again")
    return np.frombuffer(data, "<f4" if float(head[4]) < 0 else ">f4").reshape(height, width)[::-1]


#: The word "mask" in a file name, as in ``0_mask``, ``masks3`` and ``depthMask``, but not in ``unmasked``.
_MASK = re.compile("(?<![A-Za-z])(mask|MASK)(s|S)?(?![A-Za-z])|Masks?(?![a-z])")

READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".png": _read_image,
    ".tif": _read_image,
    ".tiff": _read_image,
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".pfm": _read_pfm,
}
"""Reader of each lower-case extension."""


def is_depth_file(path: Path) -> bool:
    """Return whether a file may be a depth image: integers or floats by its header, and not named as a mask."""
    suffix = path.suffix.lower()
    if suffix not in READERS or _MASK.search(path.stem):
        return False
    if READERS[suffix] is not _read_image:
        return True
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.mode in _MODES
    except Exception:
        return suffix == ".png" and _says_16_bits(path)


def _says_16_bits(path: Path) -> bool:
    """Return whether an unreadable PNG declares 16 bits; it then counts as a failed shape and is not ignored."""
    try:
        with path.open("rb") as stream:
            head = stream.read(26)
    except OSError:
        return True
    return not head or (head[:8] == b"\x89PNG\r\n\x1a\n" and (len(head) < 26 or head[24:26] == b"\x10\x00"))


Mask = NDArray[np.bool_]

MASK_FOLDERS = ("mask", "masks")
"""Names of mask folders."""

#: Endings of image names that "mask" may replace in the name of a mask.
_DEPTH = ("depth", "Depth", "DEPTH")


def read_mask(path: Path) -> Mask:
    """Read a mask; the object is every pixel that is neither black nor fully transparent.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    InvalidMask
        If the file is unreadable.
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
    """Return a mask restricted to pixels with a depth.

    Parameters
    ----------
    mask
        Shape (h, w); nonzero on the object.
    seen
        Pixels with a depth, shape (h, w).

    Raises
    ------
    InvalidMask
        If the mask is empty, has another size, or contains no pixel with a depth.
    """
    mask = np.asarray(mask != 0)
    if mask.shape != seen.shape:
        sizes = [" x ".join(map(str, image.shape[::-1])) for image in (mask, seen)]
        raise InvalidMask(f"the mask has {sizes[0]} pixels, the image {sizes[1]}", "pass a mask of the depth image")
    if not mask.any():
        raise InvalidMask("the mask is empty", "let it be white on the object")
    if not (mask & seen).any():
        raise InvalidMask("no pixel of the mask has a depth", "check that mask and image belong to one frame")
    return np.asarray(mask & seen)


def find_mask(image: Path) -> Path | None:
    """Return the mask of an image by its usual names, next to it or in a folder ``mask`` or ``masks``; else None."""
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
                yield from named if len(named) == 1 else []  # several masks are ambiguous

"""Depth images and masks in files: Pillow reads PNG, TIFF, PGM and PFM, numpy the rest."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import DepthError
from benchmark.files import load_arrays, named_errors, names_in, open_file, read_file

if TYPE_CHECKING:
    from PIL import ImageFile

Depths = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXTENSIONS = (".png", ".tif", ".tiff", ".pgm", ".pfm", ".npy", ".npz")
"""Extensions of depth images, in lower case."""

ARRAYS = (".npy", ".npz")
"""Extensions of those that are no pictures but arrays of NumPy."""

LARGEST_SIDE = 4096
"""Maximum pixels per side. Depth cameras have about a million pixels; larger images could exhaust
the memory."""

#: Largest file of an image in bytes: one of floats, with room for a header.
_LARGEST_FILE = 8 * LARGEST_SIDE**2 + 2**16

NEAREST = 0.05
"""Least plausible median depth in metres; below it, the scale is wrong."""

FARTHEST = 200.0
"""Largest plausible median depth in metres; readings beyond it count as missing."""

#: Values that programs write for pixels without a reading, if nothing is farther; in floats also a
#: thousandth of them.
_BACKGROUND = (9_999, 10_000, 32_767, 65_504, 65_535)

#: No reading in any unit: smaller than the 1e10 of Blender, the largest float, and 2**31 - 1.
_NO_READING = 1e9

#: Share of the pixels from which one value beyond :data:`FARTHEST` is a background.
_FAR_PLANE = 0.01

#: Least number of different values of which the lowest bits say something.
_FEWEST_VALUES = 16

#: Words in names of files, folders and arrays for what is no depth along the optical axis.
_OTHER_THAN_DEPTH = {
    "disparities or inverse depths": (
        r"disp(arit(y|ies)|s)?(?![a-z])|inv(erse)?[-_ ]?depth|depth[-_ ]?inv|idepth|midas"
    ),
    "distances along rays": (
        r"(dist(ances?)?(?![-_ ]?to[-_ ]?(image[-_ ]?)?plane)|ranges?|radial|euclid(ean)?"
        r"|ray(s|depths?|lengths?)?)(?![a-z])"
    ),
    "values of a z-buffer, or scaled ones": (
        r"(z[-_ ]?buf(fer)?|ndc|log[-_ ]?depth|normali[sz]ed)(?![a-z])"
    ),
}

#: Names of arrays beside depths that say what these mean, or where they are.
_UNREAD = re.compile(
    "scale|unit|offset|factor|crop|intrinsic|camera|mask|^k$|(^|_)(min|max|near|far)(_|$)",
    re.IGNORECASE,
)

#: Sample format of floats in a TIFF file.
_FLOATS_OF_TIFF = 3

#: First value with a bit of confidence in Android's DEPTH16, whose lower 13 bits are the depth.
_CONFIDENCE = 2**13

#: Largest difference of the depths of neighbours on one surface, in units of the image.
_LARGEST_STEP = 200

#: Least number of neighbours of another confidence that show its bits.
_FEWEST_STEPS = 20

_NUMBERS_FOLLOW = "numbers follow the pixels that its header announces"

_END_OF_PNG = b"IEND\xaeB`\x82"

FEWEST_SEEN = 200
"""Minimum number of pixels with a depth, as the projection requires of a shape."""

MASK_FOLDERS = ("mask", "masks")
"""Names of mask folders."""

#: Factors that put three channels of up to 16 bits side by side in one number.
_PLACES_OF_CHANNELS = (1, 2**16, 2**32)

#: Numbers of channels that a mask may have: grey, colours, and colours with opacity.
_CHANNELS_OF_MASKS = (1, 3, 4)

#: Least number of values of a mask that JPEG or smoothing blurred.
_FEWEST_GREYS = 7

#: Most grey pixels with eight equal neighbours in such a mask, as a share of the bright ones.
_MOST_FLAT = 0.05

#: Tag of images that viewers turn.
_ORIENTATION = 0x0112

#: The word "mask" in a file name, as in ``0_mask``, ``masks3`` and ``depthMask``, but not in
#: ``unmasked``.
_MASK = re.compile("(?<![A-Za-z])(mask|MASK)(s|S)?(?![A-Za-z])|Masks?(?![a-z])")

#: Extension of what may be a mask.
_PICTURE = r"\.(png|jpe?g|tiff?|bmp|gif|webp|pbm|pgm|npy|npz)"

#: Decoders of Pillow that stretch a portable grey map to 16 bits, from its stated maximum.
_STRETCHING = ("ppm", "ppm_plain")


def read_values(path: Path) -> NDArray[Any]:
    """Read a depth image; its values stay in the unit of the file.

    Parameters
    ----------
    path
        A file with one of the :data:`EXTENSIONS`. An ``.npz`` file holds a single array, or one
        that is named ``depth``.

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
            raise DepthError(
                f"unknown extension '{suffix}'", f"convert it to one of {', '.join(EXTENSIONS)}"
            )
        check_names(path)
        content = read_file(path, _LARGEST_FILE)
        return _array(content) if suffix in ARRAYS else _pixels(content)


def check_names(path: Path) -> None:
    """Raise ``DepthError`` if the name of an image or of its folder says that it shows no depths.

    The name of the folder does not count if the image is named by depth itself.
    """
    _check_name(path.stem)
    if not re.search("depth|plane", path.stem, re.IGNORECASE):
        _check_name(path.parent.name)


def _check_name(name: str) -> None:
    """Raise ``DepthError`` if a name says that numbers are no depths along the optical axis."""
    words = re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower()
    for what, pattern in _OTHER_THAN_DEPTH.items():
        if re.search(f"(?<![a-z])({pattern})", words):
            raise DepthError(
                f"'{name}' names {what}",
                "convert them to depths along the optical axis, or rename it",
            )


def usual_scale(values: NDArray[Any]) -> float:
    """Return the units per metre of an image for which nothing else is stated.

    Integers are millimetres, floats metres.
    """
    return 1.0 if np.asarray(values).dtype.kind == "f" else 1000.0


def in_metres(values: NDArray[Any], scale: float | None = None) -> Depths:
    """Convert the values of a depth image to metres.

    Parameters
    ----------
    values
        Shape (h, w) or (h, w, 1), integers or floats; see :func:`readings` for values that mark
        missing depth.
    scale
        Units per metre (``--depth-scale`` on the command line). None for 1000 if the values are
        integers, or 1 if they are floats, provided that they look like depths in that unit.

    Returns
    -------
    numpy.ndarray
        Depths in metres, shape (h, w); 0 where there is no reading, or one beyond :data:`FARTHEST`.

    Raises
    ------
    DepthError
        If the image has several channels, too few pixels with a depth or a constant depth, if the
        scale is implausible, or if no scale is given and the values look like no depths.
    """
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise DepthError(
            f"invalid depth scale {scale}", "pass a positive number of units per metre"
        )
    depth = readings(values)
    units = scale or usual_scale(values)
    _check_plausible(depth, units)
    if scale is None:
        _check_looks(depth, units)
    return np.asarray(np.where(depth > FARTHEST * units, 0, depth / units))


def _check_plausible(depth: Depths, units: float) -> None:
    """Raise ``DepthError`` unless an image has enough readings, at several plausible depths.

    Parameters
    ----------
    depth
        Values of the image, shape (h, w); 0 for missing depth.
    units
        Units per metre.
    """
    seen = _nearer_than_a_far_plane(depth, FARTHEST * units)
    if len(seen) < FEWEST_SEEN:
        raise DepthError(
            f"too few pixels have a depth: {len(seen)} of {depth.size}, fewer than {FEWEST_SEEN}",
            "check that it is the depth image, and that 0, NaN and infinity mean that nothing"
            " was seen",
        )
    median = float(np.median(seen)) / units
    if not NEAREST <= median <= FARTHEST:
        raise DepthError(
            f"the median depth is {median:g} m with {units:g} units per metre",
            "pass the camera's --depth-scale, or depth_scale in dataset.toml for a folder:"
            " 1000 for millimetres, 5000 for TUM, 1 for metres",
        )
    if seen.min() == seen.max():
        raise DepthError(
            f"all {len(seen)} pixels lie at {median:g} m", "pass a depth image, not a mask"
        )


def _check_looks(depth: Depths, units: float) -> None:
    """Raise ``DepthError`` if the values of an image look raw or scaled to the range of their type.

    Parameters
    ----------
    depth
        Values of the image, shape (h, w); 0 for missing depth.
    units
        Supposed units per metre.
    """
    seen = _nearer_than_a_far_plane(depth, FARTHEST * units)
    looks = _looks_like_confidence(depth, units) or _looks_unlike_depths(seen, units)
    if looks:
        raise DepthError(
            f"the values {looks}",
            f"export depths in millimetres or metres, or pass --depth-scale {units:g} if they are,"
            f" for a folder depth_scale = {units:g} in dataset.toml",
        )


def _nearer_than_a_far_plane(depth: Depths, far: float) -> Depths:
    """Return the readings without those of a far background, shape (n,).

    Such a background is one value beyond a distance.
    """
    seen = depth[depth > 0]
    if not (seen > far).any():
        return seen
    n_farthest = np.count_nonzero(seen == seen.max())
    return seen[seen < seen.max()] if n_farthest > _FAR_PLANE * depth.size else seen


def _looks_unlike_depths(seen: Depths, units: float) -> str:
    """Return in words why the values of an image seem to be no depths; "" if they seem to be.

    Such values were scaled to the range of their type, or are raw numbers of a sensor.

    Parameters
    ----------
    seen
        Values of the pixels with a reading, shape (k,), in the unit of the image.
    units
        Supposed units per metre; 1 for floats in metres.
    """
    if units == 1:
        if seen.max() <= 1:
            return f"end at {seen.max():g}, as in a z-buffer or an image scaled to 1"
        return ""
    # The largest value is 255, 2047, 65535 or the like.
    largest = int(seen.max())
    n_bits = largest.bit_length()
    if n_bits >= 8 and largest == 2**n_bits - 1:
        return (
            f"end at {largest}, the largest of {n_bits} bits, as raw disparities of a Kinect (11)"
            " or scaled images do"
        )
    # All values are multiples of 8, up to a constant or two: their lowest bits say something else.
    whole = np.unique(seen.astype(np.int64))
    lowest_bits = np.unique(whole % 8)
    if len(whole) >= _FEWEST_VALUES and len(lowest_bits) <= 3:
        listed = ", ".join(map(str, lowest_bits))
        return f"have no lowest three bits but {listed}, as depths << 3 of the Kinect SDK"
    return ""


def _looks_like_confidence(depth: Depths, units: float) -> str:
    """Return why the upper bits of values seem to be a confidence, in words; "" if they do not.

    Android's DEPTH16 stores 13 bits of depth and, above them, 3 bits of confidence. Neighbours of
    different confidence then have nearly the same lower bits. In an image of depths alone, the
    lower bits jump by 8191 where the upper bits change.

    Parameters
    ----------
    depth
        Values of the image, shape (h, w); 0 for missing depth.
    units
        Supposed units per metre; 1 for floats in metres.
    """
    if units == 1:
        return ""
    upper_bits, lower_bits = np.divmod(depth, _CONFIDENCE)
    # Neighbours in a row whose upper bits differ, of which both have lower bits.
    differ = upper_bits[:, :-1] != upper_bits[:, 1:]
    have_lower_bits = (lower_bits[:, :-1] > 0) & (lower_bits[:, 1:] > 0)
    steps = np.abs(np.diff(lower_bits, axis=1))[differ & have_lower_bits]
    are_small = steps < _LARGEST_STEP
    if len(steps) < _FEWEST_STEPS or are_small.mean() < 0.5:
        return ""
    return (
        f"above {_CONFIDENCE - 1} repeat the depths below, as in Android's DEPTH16: 13 bits are the"
        f" depth, 3 a confidence (keep value % {_CONFIDENCE})"
    )


def readings(values: NDArray[Any]) -> Depths:
    """Return the values of a depth image as floats, with 0 for pixels without a reading.

    Values that mark a missing reading are masked, negative, NaN or infinite ones, 1e9 and more, the
    largest value of the type, and 65535, 65504, 32767, 10000 or 9999 if nothing is farther.

    Parameters
    ----------
    values
        Shape (h, w) or (h, w, 1), integers or floats.

    Raises
    ------
    DepthError
        If it is no image of one channel.
    """
    values = np.ma.filled(values, 0)
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if values.ndim != 2 or values.dtype.kind not in "iuf" or values.dtype.itemsize == 1:
        problem = f"an array of {values.dtype} and shape {values.shape} is no depth image"
        raise DepthError(problem, "pass one channel of 16 bits or more, shape (height, width)")
    _check_size(values.shape[1], values.shape[0])
    is_float = values.dtype.kind == "f"
    largest = np.finfo(values.dtype).max if is_float else np.iinfo(values.dtype).max
    raw = values.astype(np.float64)
    with np.errstate(invalid="ignore"):
        is_reading = (raw > 0) & (raw < _NO_READING) & (values != largest)
    raw[~is_reading] = 0
    _remove_backgrounds(raw, is_float=is_float)
    return raw


def _remove_backgrounds(raw: Depths, *, is_float: bool) -> None:
    """Set to 0, in place, the largest value of an image for as long as it marks a background.

    Parameters
    ----------
    raw
        Values of the image, shape (h, w); 0 for missing depth.
    is_float
        Whether the file holds floats, in which such values may be given in metres.
    """
    farthest = raw.max(initial=0)
    while _is_background(farthest, is_float=is_float):
        raw[raw == farthest] = 0
        farthest = raw.max(initial=0)


def _is_background(farthest: float, *, is_float: bool) -> bool:
    """Return whether the largest value of an image is one of a background.

    Programs write such values where nothing was seen.
    """
    return farthest in _BACKGROUND or (is_float and round(1000 * farthest, 1) in _BACKGROUND)


def _check_size(width: int, height: int) -> None:
    """Raise ``DepthError`` if an image is too large."""
    if max(width, height) > LARGEST_SIDE:
        problem = f"{width} x {height} pixels are more than {LARGEST_SIDE} per side"
        raise DepthError(problem, "reduce it, and its intrinsics alike")


def _pixels(content: bytes) -> NDArray[Any]:
    """Return the values of a depth image in an image file such as PNG, shape (h, w).

    Parameters
    ----------
    content
        Bytes of the file.

    Raises
    ------
    DepthError
        If it holds no depth: colours, 8 bits, several images, or scaled values.
    """
    with _opened(content) as image:
        _check_size(*image.size)
        scale = image.info.get("scale", 1)  # of a PFM
        if scale != 1:
            raise DepthError(f"its scale factor is {scale:g}, not 1", "multiply the depths by it")
        if image.mode != "F" and not image.mode.startswith("I"):
            kind = "8 bits" if image.mode in ("L", "1", "P") else f"colours ({image.mode})"
            raise DepthError(
                f"the image holds {kind}, no depth",
                "export depth with 16 bits per pixel and one channel",
            )
        maximum = _stated_maximum(image)  # before the pixels are read, which forgets it
        values = np.array(image)
        has_16_bits_in_32 = image.mode == "I" and image.format in ("PNG", "PPM")
        if not has_16_bits_in_32:
            return values
        return np.asarray(np.round(values * (maximum / 65535)).astype(np.uint16))


def _stated_maximum(image: ImageFile.ImageFile) -> int:
    """Return the maximum that the header of a PGM states; 65535 for files that are not stretched.

    Pillow stretches the values of a PGM from its maximum to 65535, unless both are the same.
    """
    if image.format != "PPM":
        return 65535
    tile: Any = image.tile[0]
    decoder, _, _, arguments = tile
    return int(arguments[-1]) if decoder in _STRETCHING else 65535


def _check_grey_map(image: ImageFile.ImageFile, content: bytes) -> None:
    """Check what Pillow does not: that a PGM or PFM holds the pixels that its header announces.

    Pillow ignores what follows the pixels, takes the first byte behind a header as its end, and
    cuts values off at the stated maximum.

    Parameters
    ----------
    image
        The image that Pillow opened.
    content
        Bytes of its file.

    Raises
    ------
    ValueError
        If other numbers follow its header, or larger ones than the maximum.
    """
    kind = content[:2]
    if kind == b"P2":  # a PGM in text, of which Pillow itself refuses larger numbers
        body = content[image.tile[0].offset :]
        if body[-1:].isdigit():
            raise ValueError("its last line has no line break, so it may be cut off")
        without_comments = re.sub(rb"#[^\n]*", b"", body)
        if len(without_comments.split()) > image.width * image.height:
            raise ValueError(_NUMBERS_FOLLOW)
    elif kind == b"P5":  # a binary PGM of 8 or 16 bits
        n_bytes = 1 if image.mode == "L" else 2
        pixels = _binary_pixels(image, content, n_bytes)
        largest = int(np.frombuffer(pixels, f">u{n_bytes}").max(initial=0))
        stated = _stated_maximum(image)
        if largest > stated:
            raise ValueError(f"a pixel is {largest}, more than the maximum {stated} of its header")
    elif kind == b"Pf":  # a PFM of 32 bits
        _binary_pixels(image, content, 4)


def _binary_pixels(image: ImageFile.ImageFile, content: bytes, n_bytes: int) -> bytes:
    """Return the bytes of the pixels of a binary PGM or PFM; none if it is truncated.

    Pillow itself says that a file is truncated. A line break of Windows has two bytes, of which it
    would take the second for a part of the first pixel.

    Parameters
    ----------
    image
        The image that Pillow opened.
    content
        Bytes of its file.
    n_bytes
        Bytes of a pixel.

    Raises
    ------
    ValueError
        If the pixels do not begin or end where Pillow assumes.
    """
    start = image.tile[0].offset
    size = image.width * image.height * n_bytes
    pixels = content[start : start + size]
    tail = content[start + size :]
    if tail and content[start - 1 : start + 1] == b"\r\n":
        raise ValueError("its header ends with a line break of two bytes")
    if len(tail) > n_bytes or tail.strip(b"\0 \t\r\n"):
        raise ValueError(_NUMBERS_FOLLOW)
    return pixels if len(pixels) == size else b""


def _opened(content: bytes) -> ImageFile.ImageFile:
    """Open an image file that must hold a single, complete image.

    Parameters
    ----------
    content
        Bytes of the file.

    Raises
    ------
    DepthError
        If the file is truncated, holds several images, is turned by a tag, or has an encoding that
        cannot be read.
    """
    from PIL import Image  # lazy: most verbs read no image

    if content[12:16] == b"\x89PNG":
        problem = "it is compressedDepth of ROS, a PNG behind a header of 12 bytes"
        raise DepthError(
            problem, "convert it: ros2 run image_transport republish compressedDepth raw"
        )
    if content[:2] in (b"II", b"MM"):
        _check_samples(content)
    with Image.open(io.BytesIO(content)) as image:
        image.verify()
        if image.format == "PPM":
            _check_grey_map(image, content)
        if image.format == "PNG" and _END_OF_PNG not in content:
            raise DepthError("the file is truncated", "export the image again")
    image = Image.open(io.BytesIO(content))  # again, as Pillow cannot read what it verified
    n_images = getattr(image, "n_frames", 1)
    if n_images != 1:
        raise DepthError(f"it holds {n_images} images", "write one image per file")
    if image.getexif().get(_ORIENTATION, 1) != 1:
        raise DepthError(
            "its orientation tag turns it", "write the pixels as they are seen, without the tag"
        )
    return image


def _check_samples(content: bytes) -> None:
    """Raise ``DepthError`` if Pillow cannot read the numbers of a TIFF, such as 64-bit floats."""
    from PIL.TiffImagePlugin import BITSPERSAMPLE, SAMPLEFORMAT, ImageFileDirectory_v2  # lazy

    is_large = b"+" in content[2:4]  # of more than 4 GiB
    directory = ImageFileDirectory_v2(content[: 16 if is_large else 8])
    stream = io.BytesIO(content)
    stream.seek(directory.next)
    directory.load(stream)
    bits = max(directory.get(BITSPERSAMPLE, (1,)))
    is_float = directory.get(SAMPLEFORMAT, (1,))[0] == _FLOATS_OF_TIFF
    if bits > 32 or (is_float and bits != 32):
        kind = "floats" if is_float else "integers"
        hint = "write floats of 32 bits, such as array.astype('float32'), or integers of 16"
        raise DepthError(f"{kind} of {bits} bits in a TIFF file are not read", hint)


def _array(content: bytes) -> NDArray[Any]:
    """Return the depths in an NPY or NPZ file.

    Parameters
    ----------
    content
        Bytes of the file. An NPZ file holds one array, or one named ``depth``. Sizes are checked
        before an array is read, as a small file can declare any.

    Raises
    ------
    DepthError
        If it is not clear which array holds the depths, or another one says what they mean.
    """
    loaded = load_arrays(content)
    if isinstance(loaded, np.ndarray):
        return loaded
    with loaded as archive:
        names = archive.files
        name = "depth" if "depth" in names else next(iter(names), "")
        _check_name(name)
        unread = [other for other in names if _UNREAD.search(other)]
        if unread:
            hint = (
                "apply it to the depths, or write the camera or the mask beside the image,"
                " and leave it out"
            )
            raise DepthError(f"'{unread[0]}' of the archive is not read", hint)
        if name != "depth" and len(names) != 1:
            listed = ", ".join(names[:6]) or "nothing"
            raise DepthError(f"the archive holds {listed}", "name the array of depths 'depth'")
        return _array(_member(archive, name))


def _member(archive: Any, name: str) -> bytes:
    """Return the bytes of an array in an archive, to its end, where its checksum is compared."""
    if archive.zip.getinfo(f"{name}.npy").file_size > _LARGEST_FILE:
        raise DepthError(f"the array has more than {LARGEST_SIDE} pixels per side", "reduce it")
    return bytes(archive.zip.read(f"{name}.npy"))


def is_depth_file(path: Path) -> bool:
    """Return whether a file may be a depth image, judging by its name and its header.

    Such a file is not named as a mask, and holds floats, or integers of more than 8 bits.
    """
    if not _is_named_like_depths(path):
        return False
    mode = _mode_of(path)
    return mode in ("", "F") or mode.startswith("I")


def is_grey_picture(path: Path) -> bool:
    """Return whether a file holds 8 bits of one channel, as depths that lost their precision.

    Masks are named as such, and do not count.
    """
    return _is_named_like_depths(path) and _mode_of(path) == "L"


def _is_named_like_depths(path: Path) -> bool:
    """Return whether a file has the extension of a depth image, and is not named as a mask."""
    return path.suffix.lower() in EXTENSIONS and not _MASK.search(path.stem)


def _mode_of(path: Path) -> str:
    """Return the mode of an image as Pillow calls it, such as "L" for grey of 8 bits.

    It is empty for an array, and for a damaged image, whose error is reported when it is read.
    """
    if path.suffix.lower() in ARRAYS:
        return ""
    from PIL import Image

    try:
        with open_file(path) as file, Image.open(file) as image:
            return str(image.mode)
    except Exception:  # Pillow raises errors of any type
        return ""


def read_mask(path: Path) -> Mask:
    """Read a mask: white on the object, black or transparent elsewhere; see :func:`checked_mask`.

    Returns
    -------
    numpy.ndarray
        Shape (h, w), bool.

    Raises
    ------
    DepthError
        If the file is unreadable, or holds more than one object.
    """
    hint = "pass a PNG that is white on the object and black elsewhere"
    with named_errors(path, "mask", DepthError, hint):
        content = read_file(path, _LARGEST_FILE)
        if path.suffix.lower() in ARRAYS:
            return _object(_mask_array(content))
        with _opened(content) as image:
            _check_size(*image.size)
            has_palette = image.mode in ("P", "PA", "LA", "RGBa")
            return _object(np.array(image.convert("RGBA") if has_palette else image))


def _mask_array(content: bytes) -> NDArray[Any]:
    """Return the mask in an NPY or NPZ file.

    Parameters
    ----------
    content
        Bytes of the file. An NPZ file holds a single array, or one that is named ``mask``.

    Returns
    -------
    numpy.ndarray
        Booleans or numbers, shape (h, w) or (h, w, channels).

    Raises
    ------
    DepthError
        If it is not clear which array is the mask, or it cannot be one.
    """
    loaded = load_arrays(content)
    if isinstance(loaded, np.ndarray):
        _check_is_mask(loaded)
        _check_size(loaded.shape[1], loaded.shape[0])
        return loaded
    with loaded as archive:
        names = archive.files
        if "mask" not in names and len(names) != 1:
            listed = ", ".join(names[:6]) or "nothing"
            raise DepthError(f"the archive holds {listed}", "name the array of the mask 'mask'")
        name = "mask" if "mask" in names else names[0]
        return _mask_array(_member(archive, name))


def _check_is_mask(mask: NDArray[Any]) -> None:
    """Raise ``DepthError`` unless an array may be a mask: numbers, grey or in colours."""
    is_image = mask.ndim == 2 or (mask.ndim == 3 and mask.shape[2] in _CHANNELS_OF_MASKS)
    if not is_image or mask.dtype.kind not in "biuf":
        problem = f"an array of {mask.dtype} and shape {mask.shape} is no mask"
        raise DepthError(problem, "pass booleans or numbers, shape (height, width)")


def _object(mask: NDArray[Any]) -> Mask:
    """Return the pixels of the object in a mask as booleans, shape (h, w).

    Parameters
    ----------
    mask
        Shape (h, w), or (h, w, channels) in colours. One value besides 0 marks the object. If JPEG
        or smoothing has blurred a white object on black, it is what is lighter than half.

    Raises
    ------
    DepthError
        If it is no image, or holds several values, such as the labels of several objects.
    """
    _check_is_mask(mask)
    if mask.ndim == 3:
        mask = mask[..., 0] if mask.shape[2] == 1 else _one_channel(mask)
    values = np.unique(mask)
    levels = values[values != 0]
    if len(levels) <= 1:
        return np.asarray(mask != 0)
    if not _is_blurred(mask, values):
        problem = f"the mask holds {_listed_levels(levels)}, not one object"
        raise DepthError(problem, "write the pixels of the object alone, as 255 on 0")
    return np.asarray(mask > values[-1] / 2)


def _one_channel(mask: NDArray[Any]) -> NDArray[Any]:
    """Return one number for each pixel of a mask in colours, shape (h, w).

    - For a picture that is cut out, with more than two colours and clear pixels: the opacity.
    - For a grey mask without clear pixels: the grey.
    - For any other mask: its colours as numbers, with 0 for black and for clear pixels.

    Parameters
    ----------
    mask
        Shape (h, w, 3), or (h, w, 4) with the opacity; 8 or 16 bits.
    """
    has_opacity = mask.shape[-1] == 4
    is_clear = np.zeros(mask.shape[:2], dtype=bool)
    if has_opacity:
        is_clear = mask[..., 3] == 0
    is_clear_somewhere = bool(is_clear.any())

    visible = np.where(is_clear[..., None], 0, mask[..., :3]).astype(np.int64)
    colours = visible @ _PLACES_OF_CHANNELS
    is_picture = len(np.unique(colours)) > 2
    if is_clear_somewhere and is_picture:
        return np.asarray(mask[..., 3])

    is_grey = (mask[..., :3] == mask[..., :1]).all()
    if is_grey and not is_clear_somewhere:
        return np.asarray(mask[..., 0])
    return np.asarray(colours)


def _listed_levels(levels: NDArray[Any]) -> str:
    """Return the values of a mask in words, of many the first ones."""
    listed = ", ".join(f"{value:g}" for value in levels[:4])
    if levels[-1] >= 2**16:
        listed = "several colours"
    return f"{listed} ..." if len(levels) > 4 else listed


def _is_blurred(mask: NDArray[Any], values: NDArray[Any]) -> bool:
    """Return whether a mask is white on black, blurred at its edge by JPEG or smoothing.

    Such a mask has many greys, which lie at its edge. A mask with the labels of several objects, by
    contrast, has few values, or flat areas of one grey.

    Parameters
    ----------
    mask
        Shape (h, w).
    values
        Its distinct values, ascending.
    """
    from scipy.ndimage import maximum_filter, minimum_filter  # lazy

    white = values[-1]
    if white not in (255, 65535) or len(values) < _FEWEST_GREYS:
        return False
    is_grey = (mask > 0) & (mask < white)
    equals_its_neighbours = maximum_filter(mask, 3) == minimum_filter(mask, 3)
    n_flat = (is_grey & equals_its_neighbours).sum()
    is_bright = mask > 0.75 * white
    is_unclear = (mask > 0.25 * white) & ~is_bright
    n_bright = is_bright.sum()
    return bool(n_flat <= _MOST_FLAT * n_bright and is_unclear.sum() <= n_bright)


def checked_mask(mask: NDArray[Any], seen: Mask) -> Mask:
    """Check the mask of an object in a depth image, and return it as booleans.

    Parameters
    ----------
    mask
        Shape (h, w), or (h, w, channels) in colours. It has two values, or is white on black with
        blurred edges, of which the lighter half counts.
    seen
        Pixels of the image with a depth, shape (h, w).

    Returns
    -------
    numpy.ndarray
        Pixels of the object, with and without a depth, shape (h, w).

    Raises
    ------
    DepthError
        If the mask is empty, holds several values, has another size, or contains no pixel with a
        depth.
    """
    mask = _object(mask)
    if mask.shape != seen.shape:
        sizes = [" x ".join(map(str, image.shape[::-1])) for image in (mask, seen)]
        raise DepthError(
            f"the mask has {sizes[0]} pixels, the image {sizes[1]}",
            "pass a mask of the depth image",
        )
    if not mask.any():
        raise DepthError("the mask is empty", "let it be white on the object")
    if not (mask & seen).any():
        raise DepthError(
            "no pixel of the mask has a depth", "check that mask and image belong to one frame"
        )
    return mask


def find_mask(image: Path) -> Path | None:
    """Find the mask of a depth image by its usual names.

    The mask of ``NAME.png``, ``NAME_depth.png`` or ``depth_NAME.png`` is ``NAME_mask.png`` or
    ``mask_NAME.png`` beside it, or ``NAME.png`` in a folder ``mask`` or ``masks``. That folder lies
    beside the image or beside its folder; masks of several folders lie in sub-folders of it, as
    ``masks/CLASS/NAME.png`` for ``CLASS/NAME.png``.

    Parameters
    ----------
    image
        Path of the depth image.

    Returns
    -------
    Path or None
        The mask; None if there is none.

    Raises
    ------
    DepthError
        If there are several.
    """
    image = image.absolute()  # a relative path may not name the folders above
    stems = _stems_of(image)
    found = _pictures(image.parent, stems, "[._-]masks?([^a-z].*)?")
    found += _pictures(image.parent, stems, "", start="masks?[._-]")
    with_longer_names: list[Path] = []
    for folder in _mask_folders(image):
        found += _pictures(folder, stems, "(_mask)?", start="(masks?[._-])?")
        with_longer_names += _pictures(folder, stems, "_.*")
    if not found:
        # "masks/a_1.png" is the mask of "a.png" only if there is no image "a_1.png" or "a_1.tif".
        found = [path for path in with_longer_names if not _is_of_another(path, image)]
    if len(found) > 1:
        first, second = _names_below_common_folder(image, found[:2])
        raise DepthError(f"it has the masks {first} and {second}", "keep that of the object", image)
    return found[0] if found else None


def _names_below_common_folder(image: Path, masks: Sequence[Path]) -> list[str]:
    """Return paths of masks, from the lowest folder that holds them and the folder of the image."""
    common = os.path.commonpath([image.parent, *(mask.parent for mask in masks)])
    return [mask.relative_to(common).as_posix() for mask in masks]


def _stems_of(image: Path) -> set[str]:
    """Return the names by which masks name an image: its own, and that without the word depth."""
    depth = "(depth|Depth|DEPTH)"
    without_depth = re.sub(f"[._-]*{depth}$|^{depth}[._-]+", "", image.stem)
    return {image.stem, without_depth or image.stem}


def _is_of_another(mask: Path, image: Path) -> bool:
    """Return whether a mask names another image more closely than one that it may belong to.

    Parameters
    ----------
    mask
        A mask whose name begins with that of the image.
    image
        The image, beside which others lie.
    """
    named = [stem for stem in _stems_of(image) if mask.stem.startswith(f"{stem}_")]
    own = max(named, key=len)
    for other in map(Path, names_in(image.parent)):
        if other.suffix.lower() in EXTENSIONS:
            for stem in _stems_of(other):
                is_nearer = len(stem) > len(own) and f"{mask.stem}_".startswith(f"{stem}_")
                if is_nearer:
                    return True
    return False


def _mask_folders(image: Path) -> list[Path]:
    """Return the folders that may hold the mask of an image.

    A folder of masks lies beside the image or beside its folder. The latter, and one beside the
    folder above, may have a sub-folder with the name of the folder of the image.
    """
    folders: list[Path] = []
    for level, above in enumerate(image.parents[:3]):
        for folder in mask_folders_in(above):
            if level < 2:
                folders.append(folder)
            if level > 0:
                folders.append(folder / image.parent.name)
    return folders


def mask_folders_in(folder: Path) -> list[Path]:
    """Return the sub-folders whose names say that they hold masks."""
    return [folder / name for name in names_in(folder) if name.lower() in MASK_FOLDERS]


def _pictures(folder: Path, stems: Iterable[str], end: str, start: str = "") -> list[Path]:
    """Return the pictures in a folder whose names are a start, one of some stems, and an end.

    Start and end are regular expressions.
    """
    known = "|".join(map(re.escape, stems))
    wanted = re.compile(f"(?i:{start})({known})(?i:{end}{_PICTURE})")
    return sorted(folder / name for name in names_in(folder) if wanted.fullmatch(name))

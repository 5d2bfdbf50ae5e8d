"""Intrinsics of a pinhole camera, and the rays of its pixels.

They are read from text, files of Open3D, ROS or OpenCV, or four numbers.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import DepthError
from benchmark.files import (
    check_different,
    decode,
    named_errors,
    names_in,
    parse_json,
    read_file,
)

Rays = NDArray[np.float64]

#: Names of intrinsics files, in the folder of the image or in one of its two parents: not those of
#: colour cameras.
CAMERA_FILES = re.compile(
    r"(?=[cdikm])"  # leaves out most names at once
    r"(?=.*(camera|intrinsic|\bk\b))"
    r"((camera|depth|info|intrinsics?|k|matrix)[-_ ]?)+\.(json|txt|ya?ml)",
    re.IGNORECASE,
)

CENTRAL = (0.4, 0.6)
"""Bounds of the principal point as fractions of width and height, if the intrinsics do not give the
image size."""

#: Coefficients of Brown's model with its rational extension, in the order of OpenCV.
_BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
#: Names of the focal lengths and of the principal point.
_FOCAL = ("fx", "fy", "cx", "cy")

#: Names of Brown's model in files; an empty name means this model.
_BROWN_NAMES = (
    "",
    "plumb_bob",
    "rational_polynomial",
    "brown_conrady",
    "brown",
    "radtan",
    "opencv",
    "pinhole",
)

#: Models other than a pinhole camera, rejected with any coefficients; other unknown models may have
#: zero coefficients.
_BEYOND_PINHOLE = "fish_?eye|equidistant|kannala|f_?theta|omni|(^|_)mei(_|$)|unified|panoram"

#: Keys by meaning, without their separators. A depth scale is in units per metre, in metres per
#: unit (RealSense) or in millimetres per unit (BOP); units are always per metre.
_KEYS = {
    "matrix": "k cameramatrix camk intrinsics intrinsic",
    "columns": "intrinsicmatrix",  # Open3D
    "projection": "p projectionmatrix",  # ROS
    "width": "width imagewidth w cols",
    "height": "height imageheight h rows",
    "fx": "fx flx",
    "fy": "fy fly",
    "cx": "cx ppx",
    "cy": "cy ppy",
    "coefficients": "distortioncoefficients distortioncoeffs distortion distcoeffs coeffs d",
    "model": "distortionmodel model cameramodel cameratype lensmodel lenstype projection",
    **{name: name for name in _BROWN},
    "units": "depthmapfactor",  # ORB-SLAM
    "size": "resolution",  # Kalibr
    "scale": "depthscale pngdepthscale integerdepthscale depthunits depthunit depthfactor"
    " depthscalefactor depthunitscalefactor depthscalingfactor",
}

#: The meaning of each key.
_MEANINGS: dict[str, str] = {}
for _meaning_of_keys, _keys in _KEYS.items():
    _MEANINGS.update(dict.fromkeys(_keys.split(), _meaning_of_keys))

#: Keys of the cameras in a camchain of Kalibr, and of those of the images of a scene in BOP.
_CHAINED = re.compile(r"(cam)?\d+")

#: Keys, without their separators, below which a file may have those of its camera.
_NESTED = ("camera", "parameters", "calibration")

#: Prefixes of keys in the settings of ORB-SLAM; "Camera1" is the first camera of its third version.
_SECTION = re.compile(r"(camera1?|rgbd|stereo)\.", re.IGNORECASE)

#: Words in keys that change neither where a pixel looks nor what its depth means, as in
#: ``timestamp``, ``serial_number`` and ``frame rate``; ``camera_angle_x`` repeats ``fl_x``.
_IRRELEVANT_WORDS = re.compile(
    r"(?<![a-z])(header|seq|stamp|n?secs?|nanosec|id|name|class|date|time|timestamp|version|"
    r"comment|description|notes?|"
    r"serial|number|fps|rate|path|file|url|dt|"
    r"rostopic|timeshift|overlaps|"
    r"w2c|c2w|baseline|rectification|errors?|board|square|points|nframes|flags|aabb|sharpness|"
    r"angle|device|sensor|manufacturer)(?![a-z])"
)

#: Keys in the settings of ORB-SLAM that say nothing of the camera's image: ``Viewer.PointSize``.
_SETTINGS_OF_SLAM = re.compile(
    r"camera1?\.(rgb|bf)|(stereo\.)?(thdepth|b)|tbc|"
    r"(orbextractor|viewer|imu|system|loopclosing)\..*",
    re.IGNORECASE,
)

#: Words in keys of where the camera is, if several numbers follow: ``transform_matrix``.
_WORDS_OF_POSES = re.compile(
    "(?<![a-z])(extrinsics?|pose|rotation|translation|transform|[rt])(?![a-z])"
)

#: Words in keys of factors, of which 1 changes nothing: ``binning_x``, ``pixel_aspect``.
_WORDS_OF_FACTORS = re.compile("binning|aspect")

#: Fewest numbers of a pose; a key such as ``r`` with fewer means something else.
_FEWEST_OF_POSE = 3

#: Units per metre.
_UNITS = {
    "m": 1.0,
    "cm": 100.0,
    "mm": 1e3,
    "um": 1e6,
    "meter": 1.0,
    "centimeter": 100.0,
    "millimeter": 1e3,
}

#: Largest skew of a camera matrix that is rounding, in pixels.
_LARGEST_SKEW = 1e-6

#: Largest file in bytes.
_LARGEST_FILE = 100_000

#: Most levels of YAML.
_DEEPEST = 20

#: What to write instead of a file or numbers that are not understood.
_HINT = "write a 3 x 3 matrix, camera.json of Open3D, camera_info.yaml of ROS, or fx,fy,cx,cy"

#: Iterations to find the ray of a distorted pixel; lenses of depth cameras need five.
_STEPS = 20

#: Bounds of plausible focal lengths, in widths or heights of the image.
_FOCAL_LENGTHS = (0.1, 20)

#: Largest coordinate of a ray at depth 1: one of 89.4 degrees off the axis.
_STEEPEST = 100

#: Largest distance in pixels from where a ray appears to the pixel that it is found for.
_LARGEST_MISS = 0.5


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera.

    Parameters
    ----------
    fx, fy
        Focal lengths in pixels.
    cx, cy
        Principal point in pixels; the centre of the first pixel is at 0.
    size
        Width and height of the image; None if unknown.
    distortion
        Coefficients k1, k2, p1, p2, k3, k4, k5, k6 of Brown's model with its rational extension, in
        OpenCV's order; empty for no distortion.
    scales
        Units of a depth image per metre, in all readings of a depth scale in the file of the
        camera; see :func:`benchmark.depth.frame.scale_of`.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None = None
    distortion: tuple[float, ...] = ()
    scales: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Raise ``DepthError`` unless all numbers are finite and the focal lengths positive."""
        values = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not (all(map(math.isfinite, values)) and self.fx > 0 and self.fy > 0):
            problem = (
                f"invalid focal lengths {self.fx:g}, {self.fy:g}"
                f" with centre {self.cx:g}, {self.cy:g}"
            )
            raise DepthError(problem, "pass positive focal lengths in pixels")

    def check_size(self, width: int, height: int) -> None:
        """Raise ``DepthError`` unless the intrinsics can be those of an image of this size.

        Parameters
        ----------
        width, height
            Size of the image in pixels.

        Raises
        ------
        DepthError
            If they state another size, the focal lengths are implausible, or the principal point
            lies outside the image, or far from its middle if they state no size.
        """
        if self.size is not None and self.size != (width, height):
            own = " x ".join(map(str, self.size))
            raise DepthError(
                f"the intrinsics are those of {own} pixels, the image has {width} x {height}",
                "pass those of the depth image at this resolution",
            )
        least, largest = _FOCAL_LENGTHS
        is_plausible = least < self.fx / width < largest and least < self.fy / height < largest
        if not is_plausible:
            problem = (
                f"the focal lengths {self.fx:g}, {self.fy:g}"
                f" are implausible for {width} x {height} pixels"
            )
            raise DepthError(problem, "pass them in pixels of this image")
        self._check_principal_point(width, height)

    def _check_principal_point(self, width: int, height: int) -> None:
        """Raise ``DepthError`` if the principal point is implausible for an image of this size.

        It must lie near the middle of the image. If the intrinsics state the size of the image, it
        may lie anywhere in it, because the image may be cut out of a larger one.

        Parameters
        ----------
        width, height
            Size of the image in pixels.
        """
        # Bounds of the principal point, in widths and heights of the image.
        low, high = (0.0, 1.0) if self.size else CENTRAL
        is_within_width = low * width <= self.cx + 0.5 <= high * width
        is_within_height = low * height <= self.cy + 0.5 <= high * height
        if not (is_within_width and is_within_height):
            problem = (
                f"the principal point {self.cx:g}, {self.cy:g}"
                f" is far from the middle of {width} x {height}"
            )
            hint = (
                "pass the intrinsics of this image, not of one turned;"
                " for a part of one, add its width and height"
            )
            raise DepthError(problem, hint)

    @functools.lru_cache(maxsize=4)  # noqa: B019
    def rays(self, width: int, height: int) -> Rays:
        """Return where each pixel's ray has depth 1, shape (height, width, 2).

        The two numbers are right and down.
        """
        x = (np.arange(width) - self.cx) / self.fx
        y = (np.arange(height) - self.cy) / self.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)
        if any(self.distortion):
            rays = _undistorted(rays, self.distortion, _LARGEST_MISS / max(self.fx, self.fy))
        rays.flags.writeable = False
        return rays


def _undistorted(seen: Rays, coefficients: Sequence[float], largest_miss: float) -> Rays:
    """Remove Brown's lens distortion [1971] from rays, by fixed-point iteration as in OpenCV.

    Parameters
    ----------
    seen
        Distorted rays, x and y at depth 1, shape (h, w, 2).
    coefficients
        k1, k2, p1, p2, k3, k4, k5 and k6, in OpenCV's order; missing ones are 0.
    largest_miss
        How far from the distorted rays those that are found may appear, at depth 1.

    Returns
    -------
    numpy.ndarray
        Rays without distortion, shape (h, w, 2).

    Raises
    ------
    DepthError
        If the iteration does not converge: no ray appears there, or it is too steep.
    """
    rays = seen
    with np.errstate(all="ignore"):  # rays that diverge are refused below
        for _ in range(_STEPS):
            inverse_factor, shift = _distortion_of(rays, coefficients)
            rays = (seen - shift) * inverse_factor
        inverse_factor, shift = _distortion_of(rays, coefficients)
        misses = np.abs(rays / inverse_factor + shift - seen)
    # Neither holds for NaN.
    if not (np.abs(rays).max() < _STEEPEST and misses.max() < largest_miss):
        raise DepthError(
            f"distortion {coefficients} cannot be inverted on this image",
            "check its coefficients, or rectify the image",
        )
    return rays


def _distortion_of(rays: Rays, coefficients: Sequence[float]) -> tuple[Rays, Rays]:
    """Return by what a lens distorts rays: a radial factor and a tangential shift.

    Parameters
    ----------
    rays
        Rays without distortion, shape (h, w, 2).
    coefficients
        As in :func:`_undistorted`.

    Returns
    -------
    inverse_factor : numpy.ndarray
        One over the factor, shape (h, w, 1).
    shift : numpy.ndarray
        The shift, which is added after the multiplication, shape (h, w, 2).
    """
    padding = [0.0] * (len(_BROWN) - len(coefficients))
    k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *padding)
    x = rays[..., 0]
    y = rays[..., 1]
    r2 = x * x + y * y  # the squared radius
    numerator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    denominator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    tangential_x = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    tangential_y = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return (numerator / denominator)[..., None], np.stack([tangential_x, tangential_y], axis=-1)


def parse_intrinsics(text: str) -> Intrinsics:
    """Parse ``fx,fy,cx,cy`` or the numbers of a matrix; raises ``DepthError`` for anything else."""
    words = re.sub(r"(?<!\S)(#|%|//).*|[\[\],;]", " ", text).split()
    try:
        numbers = [_number(word) for word in words]
    except ValueError as error:
        raise DepthError(f"'{' '.join(text.split()):.60}' is no list of numbers", _HINT) from error
    return camera_of(numbers)


def _number(value: Any) -> float:
    """Return a number.

    Raises ``ValueError`` at texts that Python alone takes, such as ``1_0`` and other scripts.
    """
    if isinstance(value, bool) or not re.fullmatch(r"[-+.\deEinfa]+", str(value), re.ASCII):
        raise ValueError(f"'{value!s:.40}' is no number")
    return float(value)


def intrinsics_of(value: str, folder: Path = Path()) -> Intrinsics:
    """Return the intrinsics given as ``fx,fy,cx,cy`` or as a file in a folder.

    See :func:`read_intrinsics`.
    """
    if "," in value and not _is_there(folder / value):
        return parse_intrinsics(value)
    return read_intrinsics(folder / value)


def _is_there(path: Path) -> bool:
    """Return whether a path exists; False for numbers that are too long to be a name."""
    with contextlib.suppress(OSError):
        return path.exists()
    return False


def read_intrinsics(path: Path) -> Intrinsics:
    """Read the intrinsics of a camera from a file.

    Parameters
    ----------
    path
        A text with the numbers of a 3 x 3 or 4 x 4 matrix, or with fx, fy, cx and cy; or JSON or
        YAML, such as ``camera.json`` of Open3D, ``camera_info`` of ROS, a file of OpenCV, or a
        mapping with ``fx``, ``fy``, ``cx``, ``cy``.

    Raises
    ------
    DepthError
        If the file is missing, holds no camera or several, or one that is no pinhole with Brown's
        distortion, or has a key that may change where pixels look or what depths mean.
    """
    with named_errors(path, "file of intrinsics", DepthError, _HINT):
        text = decode(read_file(path, _LARGEST_FILE))
        cameras: set[Intrinsics] = set()
        for content in _parsed(text):
            for camera in _cameras_of(content):
                if isinstance(camera, Mapping):
                    cameras.add(_of_mapping(camera))
                else:  # plain numbers
                    cameras.add(parse_intrinsics(text))
        if len(cameras) > 1:
            raise DepthError(
                f"it holds {len(cameras)} different cameras", "keep that of the depth image"
            )
        return cameras.pop()


def _parsed(text: str) -> Sequence[Any]:
    """Parse the text of a file of intrinsics: JSON, YAML or plain numbers.

    Parameters
    ----------
    text
        The text; YAML may have several documents, of which each is a record of one camera.

    Returns
    -------
    sequence
        The content of JSON, or of each complete document of YAML; a single None for plain numbers.
    """
    if text.lstrip().startswith("{"):
        return [parse_json(text)]
    if ":" not in text:
        return [None]
    from yaml import load_all  # lazy

    # OpenCV writes a first line "%YAML:1.0" and tags of its own, which no parser knows.
    plain = re.sub(r"(?m)^%.*$|!!opencv-\w+", "", text)
    documents = [content for content in load_all(plain, _yaml_loader()) if content is not None]
    if not documents:
        return [None]
    # A recording of ROS may be cut off within its last document, which then lacks keys.
    *whole, last = documents
    is_cut_off = bool(whole) and {*last} < {*whole[0]}
    return whole if is_cut_off else documents


def _yaml_loader() -> type[Any]:
    """Return a class of YAML loaders that is safe for files of unknown origin.

    It reads all numbers as decimal floats, and refuses aliases, deep nesting and repeated keys.
    """
    from yaml import AliasEvent, MappingNode, Node, SafeLoader, ScalarNode  # lazy

    class Loader(SafeLoader):  # type: ignore[misc]
        depth = 0

        def compose_node(self, parent: Node | None, index: int) -> Node | None:
            """Compose a node as the base class does, and check it; numbers become floats."""
            if self.check_event(AliasEvent):  # a few aliases can expand to gigabytes
                raise ValueError("it has aliases")
            self.depth += 1
            if self.depth > _DEEPEST:
                raise RecursionError
            node = super().compose_node(parent, index)
            self.depth -= 1
            if isinstance(node, ScalarNode) and node.tag.endswith((":int", ":float")):
                _number(node.value)  # raises for hexadecimal and other odd numbers of YAML
                node.tag = "tag:yaml.org,2002:float"  # as an int, 010 would be octal
            if isinstance(node, MappingNode):
                check_different([str(key.value) for key, _ in node.value])
            return node

    return Loader


def _cameras_of(content: Any) -> Sequence[Any]:
    """Return the cameras of a camchain of Kalibr or a scene of BOP, else the content itself.

    A camchain has the keys cam0, cam1 and so on, a scene 0, 1 and so on.
    """
    if isinstance(content, Mapping) and content and all(map(_CHAINED.fullmatch, map(str, content))):
        return [*content.values()]
    return [content]


def find_intrinsics(image: Path) -> Path | None:
    """Return the file of intrinsics of an image by its usual names; None if there is none.

    It lies in the folder of the image or in one of the two above it.

    Raises
    ------
    DepthError
        If the nearest folder with one has several.
    """
    for folder in (image.parent, *image.absolute().parent.parents[:2]):
        found = sorted(folder / name for name in names_in(folder) if CAMERA_FILES.fullmatch(name))
        if len(found) > 1:
            problem = f"two camera files are near it, {found[0].name} and {found[1].name}"
            hint = (
                "keep that of the depth image; or name it, and the units if it does not state them:"
                " --intrinsics FILE --depth-scale UNITS, or in dataset.toml"
            )
            raise DepthError(problem, hint, image)
        if found:
            return found[0]
    return None


def camera_of(numbers: Sequence[float], *facts: Any) -> Intrinsics:
    """Return the camera of fx, fy, cx, cy or of a camera matrix.

    Parameters
    ----------
    numbers
        The four numbers; or the 9 or 16 numbers of a 3 x 3 or 4 x 4 matrix, row by row.
    *facts
        Further arguments of ``Intrinsics``: size, distortion and scales.

    Raises
    ------
    DepthError
        If there are more or fewer numbers, or the matrix is no camera matrix without skew.
    """
    if len(numbers) == 4:
        fx, fy, cx, cy = numbers
        return Intrinsics(fx, fy, cx, cy, *facts)
    if len(numbers) not in (9, 16):
        shown = _in_one_line(numbers)
        raise DepthError(f"expected 4, 9 or 16 numbers, found {len(numbers)}: '{shown:.60}'", _HINT)
    matrix = np.array(numbers).reshape(math.isqrt(len(numbers)), -1)
    _check_matrix(matrix)
    fx = float(matrix[0, 0])
    fy = float(matrix[1, 1])
    cx = float(matrix[0, 2])
    cy = float(matrix[1, 2])
    return Intrinsics(fx, fy, cx, cy, *facts)


def _check_matrix(matrix: NDArray[np.float64]) -> None:
    """Raise ``DepthError`` unless a matrix is a camera matrix without skew.

    Parameters
    ----------
    matrix
        Shape (3, 3), with the rows fx 0 cx, 0 fy cy and 0 0 1; or shape (4, 4), where the fourth
        row and column are zero but for the last number, which may be any.
    """
    # The matrix with the numbers that may be any, and otherwise that of no change.
    expected = np.eye(len(matrix))
    for row in (0, 1):
        expected[row, row] = matrix[row, row]
        expected[row, 2] = matrix[row, 2]
    expected[3:, 3:] = matrix[3:, 3:]
    if not np.allclose(matrix, expected, rtol=0, atol=_LARGEST_SKEW):
        rows = " / ".join(map(_in_one_line, matrix))
        is_transposed = matrix[2, :2].any() and not matrix[:2, 2].any()
        hint = "write fx 0 cx / 0 fy cy / 0 0 1"
        raise DepthError(
            f"{rows} is not a camera matrix without skew",
            f"it is transposed: {hint}" if is_transposed else hint,
        )


def _of_mapping(content: Mapping[str, Any]) -> Intrinsics:
    """Return the camera that the content of a JSON or YAML file describes.

    Parameters
    ----------
    content
        Keys and values, as in ``camera.json`` of Open3D, ``camera_info`` of ROS or files of OpenCV,
        or with named focal lengths.

    Raises
    ------
    DepthError
        If the content describes no camera or several, or one that is no pinhole with Brown's
        distortion.
    """
    values = _by_meaning(content)
    width = int(_number(values.get("width", 0)))
    height = int(_number(values.get("height", 0)))
    size = (width, height) if width > 0 and height > 0 else None
    facts = (size, tuple(_distortion(values)), _scales(values))

    # A file may say the same in several ways: as a matrix, as a projection, by names.
    cameras = {camera_of(numbers, *facts) for numbers in _numbers_of_cameras(values)}
    projection = _flat(values.get("projection", []))
    if any(projection):
        cameras.add(_rectified(projection, facts, cameras))
    keys = ", ".join(map(str, content))
    if len(cameras) > 1:
        raise DepthError(f"keys {keys:.200} contradict each other", _HINT)
    if not cameras:
        missing = " and no ".join(name for name in _FOCAL if name not in values)
        raise DepthError(f"keys {keys:.200} name no {missing}", _HINT)
    return cameras.pop()


def _in_one_line(numbers: Iterable[float]) -> str:
    """Return numbers as text."""
    return " ".join(f"{number:g}" for number in numbers)


def _numbers_of_cameras(values: Mapping[str, Any]) -> list[list[float]]:
    """Return the numbers of a camera in each way in which a file says them."""
    found = []
    if "matrix" in values:
        found.append(_flat(values["matrix"]))
    if "columns" in values:
        # Open3D lists the columns, other programs the rows under the same key. The last row of a
        # camera matrix is 0 0 1, and so is no last column.
        matrix = np.array(_flat(values["columns"])).reshape(3, 3)
        are_rows = not matrix[2, :2].any()
        found.append((matrix if are_rows else matrix.T).ravel().tolist())
    if all(name in values for name in _FOCAL):
        found.append([_number(values[name]) for name in _FOCAL])
    return found


def _rectified(
    projection: Sequence[float], facts: Sequence[Any], cameras: Collection[Intrinsics]
) -> Intrinsics:
    """Return the camera of a projection matrix.

    ROS writes the camera matrix K and the distortion of raw images, and beside them the projection
    P of rectified images. Both must be the same camera, because the file does not say which of the
    two kinds the depth image is.

    Parameters
    ----------
    projection
        Rows of the 3 x 4 or 4 x 4 matrix, 12 or 16 numbers.
    facts
        Size, distortion and scales of the camera.
    cameras
        Cameras that the rest of the file describes, if any.

    Raises
    ------
    DepthError
        If the projection has another size, or is that of another camera.
    """
    if len(projection) not in (12, 16):
        problem = f"a projection of {len(projection)} numbers"
        raise DepthError(problem, "write the 3 x 4 matrix of the projection, or leave it out")
    fx, fy, cx, cy = projection[0], projection[5], projection[2], projection[6]
    rectified = camera_of([fx, fy, cx, cy], *facts)
    is_other_camera = bool(cameras) and rectified not in cameras
    if is_other_camera or (rectified.distortion and not cameras):
        raise DepthError(
            "K and distortion are those of raw images, P is that of rectified ones",
            "leave that of the depth image; without the distortion, if it is rectified",
        )
    return rectified


def _by_meaning(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values in a file of intrinsics under the same names for all kinds of files.

    Parameters
    ----------
    content
        Keys and values of the file, such as ``"fl_x"``; a value may be a mapping itself.

    Returns
    -------
    dict
        Values by their meaning, such as ``"fx"``, ``"matrix"``, ``"coefficients"`` or ``"scale"``.

    Raises
    ------
    DepthError
        If two keys contradict each other, or an unknown key may change the camera.
    """
    values: dict[str, Any] = {}
    for key, value in content.items():
        meaning = _meaning(str(key))
        if isinstance(value, Mapping) and _letters(str(key)) in _NESTED:
            meaning = "nested"
        if not meaning:
            _check_irrelevant(str(key), value)
            continue
        for name, found in _values_of_key(key, meaning, value).items():
            if name in values and values[name] != found:
                problem = f"key '{key}' contradicts another one of {name}"
                raise DepthError(problem, "keep the right one")
            if found is not None:
                values[name] = found
    return values


def _values_of_key(key: str, meaning: str, value: Any) -> dict[str, Any]:
    """Return the values that one key of a file of intrinsics holds, by their meaning.

    Parameters
    ----------
    key
        The key as it stands in the file.
    meaning
        What the key usually means, such as ``"matrix"``; ``"nested"`` if its value is a mapping
        whose own keys have the meanings.
    value
        Its value: numbers, a text, a list or a mapping.
    """
    is_mapping = isinstance(value, Mapping)
    if meaning == "model" and (is_mapping or isinstance(value, list)):
        # In files of iai_kinect2, "projection" is a matrix and not the name of a lens model.
        return {"projection": value}
    if meaning == "nested":
        return _by_meaning(value)
    if meaning == "size":
        return _sides(value)
    if meaning == "matrix" and is_mapping and "data" not in value:
        # "intrinsics" that hold fx, fy and so on by name, instead of a matrix of OpenCV.
        return _by_meaning(value)
    if meaning == "model" or (meaning == "coefficients" and isinstance(value, str)):
        # A file may name several models, one of the lens and one of its distortion.
        return {f"model {key}": value}
    return {meaning: value}


def _sides(value: Any) -> dict[str, Any]:
    """Return width and height of a resolution."""
    if isinstance(value, Mapping):
        return _by_meaning(value)
    sides = _flat(value)
    if len(sides) != 2:
        raise DepthError(f"a resolution of {len(sides)} numbers", "write [width, height]")
    return {"width": sides[0], "height": sides[1]}


def _meaning(key: str) -> str:
    """Return what a key means; "" if it is unknown.

    Keys in the settings of ORB-SLAM may have their section before them.
    """
    for name in (key, _SECTION.sub("", key, count=1)):
        letters = _letters(name)
        if letters in _MEANINGS:
            return _MEANINGS[letters]
    return ""


def _letters(key: str) -> str:
    """Return a key in lower case without its separators."""
    return re.sub(r"[\W_]+", "", key.lower())


def _leaves(value: Any) -> Iterator[Any]:
    """Yield the numbers and texts in a value of JSON, YAML or XML, at any depth."""
    if isinstance(value, Mapping):
        value = [*value.values()]
    if isinstance(value, list | tuple | np.ndarray):
        for part in value:
            yield from _leaves(part)
    else:
        yield value


def _check_irrelevant(key: str, value: Any) -> None:
    """Reject an unknown key of a file of intrinsics unless it is harmless.

    Parameters
    ----------
    key
        The key as it stands in the file, such as ``"exposureTime"``.
    value
        Its value: a number, a text, or lists and mappings of these.

    Raises
    ------
    DepthError
        If the key may change where a pixel looks or what its depth means.
    """
    if _is_about_something_else(key, value) or _changes_nothing(key, value):
        return
    hint = (
        "remove it if it changes neither where pixels look nor what depths mean,"
        " or apply it to the image"
    )
    raise DepthError(f"key '{key}' is not understood: {value!s:.40}", hint)


def _is_about_something_else(key: str, value: Any) -> bool:
    """Return whether a key of a file of intrinsics does not concern the pixels of the image.

    Such keys are the settings of programs, poses of the camera, and names or times.

    Parameters
    ----------
    key
        The key, such as ``"Viewer.PointSize"``, ``"transform_matrix"`` or ``"timestamp"``.
    value
        Its value: a number, a text, or lists and mappings of these.
    """
    if _SETTINGS_OF_SLAM.fullmatch(key):
        return True
    words = _words_of(key)
    n_values = len(list(_leaves(value)))
    is_pose = n_values >= _FEWEST_OF_POSE and _WORDS_OF_POSES.search(words) is not None
    return is_pose or _IRRELEVANT_WORDS.search(words) is not None


def _changes_nothing(key: str, value: Any) -> bool:
    """Return whether all values of a key are neutral: 0 or empty, and for a factor also 1.

    Parameters
    ----------
    key
        The key, such as ``"binning_x"``, which is a factor.
    value
        Its value: a number, a text, or lists and mappings of these.
    """
    neutral_values: list[Any] = [None, "", 0]
    if _WORDS_OF_FACTORS.search(_words_of(key)):
        neutral_values.append(1)
    return all(leaf in neutral_values for leaf in _leaves(value))


def _words_of(key: str) -> str:
    """Return a key in lower case with its words apart: "exposure time" for ``exposureTime``."""
    return re.sub("([a-z])([A-Z])", r"\1 \2", key).lower()


def _scales(values: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the depth scales, in units per metre, that a file of intrinsics may mean.

    Parameters
    ----------
    values
        Values of the file by meaning. ``"units"`` is a number of units per metre. ``"scale"`` is
        the name of a unit, or a number that may be units per metre or its inverse.

    Returns
    -------
    tuple of float
        One scale; none if the file states no scale; the three possible ones of a number.

    Raises
    ------
    DepthError
        If the scale is not a positive number or a unit, or stated twice.
    """
    scale = values.get("scale")
    if "units" in values:
        units = _number(values["units"])
        if scale is not None or not 0 < units < math.inf:
            given = f"{units:g}" if scale is None else f"{units:g} and {scale!r:.40}"
            raise DepthError(f"invalid depth scale {given}", "write units per metre, once")
        return (units,)
    if scale is None:
        return ()
    name_of_unit = str(scale).strip().lower().replace("metre", "meter").removesuffix("s")
    if name_of_unit in _UNITS:
        return (_UNITS[name_of_unit],)
    try:
        number = _number(scale)
    except (TypeError, ValueError):
        number = math.nan
    if not 0 < number < math.inf:
        raise DepthError(f"invalid depth scale {scale!r:.40}", "write units per metre, or mm")
    # The number may be meant as units per metre, metres per unit, or millimetres per unit.
    return number, 1 / number, 1000 / number


def _flat(values: Any) -> list[float]:
    """Return the numbers of a list, a nested list, or the ``data`` of an OpenCV or ROS matrix."""
    numbers = values["data"] if isinstance(values, Mapping) else values
    return [_number(value) for value in np.ravel(numbers)]


def _distortion(values: Mapping[str, Any]) -> list[float]:
    """Return the coefficients of Brown's lens distortion in a file; empty if all are zero.

    Parameters
    ----------
    values
        Values of the file by meaning: a list ``"coefficients"``, or single numbers ``"k1"``,
        ``"p1"`` and so on; and the names of lens models.

    Raises
    ------
    DepthError
        If the file names another model, or the number of coefficients is none of Brown's model.
    """
    # The coefficients may stand in one list, or each under its name.
    lists = [[_number(values.get(name, 0)) for name in _BROWN]]
    if "coefficients" in values:
        lists.insert(0, _flat(values["coefficients"]))
    given = [coefficients for coefficients in lists if any(coefficients)]
    _check_models(values, has_distortion=bool(given))
    if not given:
        return []
    has_k4_alone = values.get("k4") and "k6" not in values
    if len(given) > 1 or len(given[0]) not in (4, 5, 8) or has_k4_alone:
        counts = " and ".join(str(len(coefficients)) for coefficients in given)
        raise DepthError(
            f"{counts} coefficients of distortion", "pass 4, 5 or 8 of Brown's model, once"
        )
    return given[0]


def _check_models(values: Mapping[str, Any], *, has_distortion: bool) -> None:
    """Raise ``DepthError`` if a model of lens or distortion is not read.

    Models that are read are that of a pinhole camera and Brown's.
    """
    named = [str(value) for key, value in values.items() if key.startswith("model")]
    for name in named:
        model = re.sub(r"[\W_]+", "_", name.lower()).removeprefix("distortion_")
        is_unknown = model not in _BROWN_NAMES and has_distortion
        if is_unknown or re.search(_BEYOND_PINHOLE, model):
            problem = f"the distortion model is '{name:.60}'"
            raise DepthError(
                problem, "rectify the image, and pass plumb_bob or rational_polynomial"
            )

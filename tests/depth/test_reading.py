"""Files of a depth camera: every way to write them says the same, and every fault has a name."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from benchmark.depth.frame import FrameFiles, scale_of
from benchmark.depth.intrinsics import Intrinsics, find_intrinsics, intrinsics_of, read_intrinsics
from benchmark.depth.reading import (
    checked_mask,
    find_mask,
    in_metres,
    is_depth_file,
    read_mask,
    read_values,
)
from benchmark.errors import DepthError

INPUTS = Path(__file__).with_name("inputs")
DEPTHS = np.linspace(0.5, 4.0, 120 * 160).reshape(120, 160).round(3)
DEPTHS[0, :5] = 0
MILLIMETRES = np.round(1000 * DEPTHS).astype(np.uint16)

OBJECT = np.zeros((120, 160), dtype=bool)
OBJECT[30:90, 50:110] = True


# --- images
# ------------------------------------------------------------------------------------------------


#: Images that are refused: a name, and what the error says.
BAD_IMAGES = dict(
    line.split("  ", 1) for line in (INPUTS / "bad-images.txt").read_text().splitlines()
)


@pytest.mark.parametrize("name", sorted(path.name for path in (INPUTS / "images").iterdir()))
def test_all_kinds_of_images_say_the_same(name: str) -> None:
    expected = np.linspace(0.5, 4.0, 30 * 40).reshape(30, 40).round(3)
    expected[0, :5] = 0
    np.testing.assert_allclose(
        in_metres(read_values(INPUTS / "images" / name)), expected, atol=1e-6
    )
    assert is_depth_file(INPUTS / "images" / name)


@pytest.mark.parametrize("kind", [b"P2", b"P5"])
@pytest.mark.parametrize("maximum", [4095, 65535])
@pytest.mark.parametrize(
    ("comment", "end"), [(b"", b"\n"), (b"# " + 2000 * b"x", b"\n"), (b"# of a camera", b"\r")]
)
def test_depths_of_a_portable_grey_map_are_its_own_whatever_its_header_says(
    tmp_path: Path, kind: bytes, maximum: int, comment: bytes, end: bytes
) -> None:
    path = tmp_path / "image.pgm"
    header = end.join([kind, comment, b"160 120", b"%d" % maximum, b""])
    pixels = MILLIMETRES.astype(">u2").tobytes()
    if kind == b"P2":
        pixels = b" ".join(b"%d" % value for value in MILLIMETRES.ravel()) + b"\n"
    path.write_bytes(header + pixels)
    np.testing.assert_array_equal(read_values(path), MILLIMETRES)


@pytest.mark.parametrize(
    ("header", "tail", "said"),
    [
        (b"P5\n160 120\n%d\n" % (MILLIMETRES.max() - 1), b"", "more than the maximum"),
        (b"P5\r\n160 120\r\n65535\r\n", b"", "header ends with a line break of two bytes"),
        (b"P5\n160 120\n65535\n", b"1234", "numbers follow the pixels"),
        (b"P5\n160 120\n65535\n\2", b"", "numbers follow the pixels"),
    ],
    ids=["maximum", "windows", "tail", "shifted"],
)
def test_a_grey_map_that_its_header_contradicts_is_refused(
    tmp_path: Path, header: bytes, tail: bytes, said: str
) -> None:
    path = tmp_path / "image.pgm"
    path.write_bytes(header + MILLIMETRES.astype(">u2").tobytes() + tail)
    with pytest.raises(DepthError, match=said):
        read_values(path)


def test_a_number_that_is_divided_in_the_text_of_a_grey_map_moves_no_pixel(tmp_path: Path) -> None:
    numbers = [b"%d" % value for value in MILLIMETRES.ravel()]
    numbers[5] = numbers[5][:1] + b" " + numbers[5][1:]
    path = tmp_path / "image.pgm"
    path.write_bytes(b"P2\n160 120\n65535\n" + b" ".join(numbers) + b"\n")
    with pytest.raises(DepthError, match="numbers follow the pixels"):
        read_values(path)


def test_labels_above_the_maximum_of_a_mask_are_not_taken_for_one_object(tmp_path: Path) -> None:
    path = tmp_path / "mask.pgm"
    labels = np.zeros((120, 160), dtype=np.uint8)
    labels[20:40, 20:40] = 1
    labels[60:80, 60:80] = 2
    path.write_bytes(b"P5\n160 120\n1\n" + labels.tobytes())
    with pytest.raises(DepthError, match="a pixel is 2, more than the maximum 1"):
        read_mask(path)


def test_a_float_map_with_line_breaks_of_windows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.pfm"
    path.write_bytes(b"Pf\r\n160 120\r\n-1.0\r\n" + MILLIMETRES.astype("<f4").tobytes())
    with pytest.raises(DepthError, match="line break of two bytes"):
        read_values(path)


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.int32, np.uint32])
def test_no_positive_number_and_the_largest_of_a_type_are_no_reading(dtype: type) -> None:
    values = np.tile(np.arange(50, 90), (30, 1)).astype(dtype)
    values[1, :2] = np.iinfo(dtype).max, 0
    depth = in_metres(values, 100)
    assert not depth[1, :2].any()
    assert depth.max() == 0.89


NOTHING = [np.nan, np.inf, -np.inf, -2, 1e10, np.finfo(np.float32).max, 65535, 65.535, 10000, 1000]


@pytest.mark.parametrize("nothing", NOTHING)
def test_a_background_is_no_reading(nothing: float) -> None:
    for kind in (
        "f4",
        "f8",
        *(("i4", "u2") if 9999 < nothing < 2**16 else ("f2",) if nothing == 1000 else ()),
    ):
        values = (DEPTHS if kind[0] == "f" else 1000 * DEPTHS).astype(kind)
        expected = np.where(OBJECT, in_metres(values), 0)
        np.testing.assert_array_equal(in_metres(np.ma.masked_array(values, ~OBJECT)), expected)
        values[~OBJECT] = nothing
        if kind in ("f4", "f8"):
            values[0, :80] = 1e10
        np.testing.assert_array_equal(in_metres(values), expected)


def test_an_object_before_pixels_without_a_reading_stands_where_it_is() -> None:
    found = FrameFiles(
        INPUTS / "depth-65535.png", read_intrinsics(INPUTS / "depth-65535.txt")
    ).observe()
    assert found.notes["distance"] == pytest.approx(2, abs=0.1)
    assert found.notes["size"] < 2


@pytest.mark.parametrize("name", [*BAD_IMAGES, "absent.png"])
def test_each_fault_of_an_image_is_named_in_one_line_with_a_hint(name: str) -> None:
    path = INPUTS / "bad-images" / name
    with pytest.raises(DepthError, match=BAD_IMAGES.get(name, "No such file")) as caught:
        FrameFiles(path, Intrinsics(25, 25, 9.5, 7.5)).observe()
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.hint


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.ones((2, 2)), "too few pixels have a depth: 4 of 4, fewer than 200"),
        (np.zeros((30, 40, 3)), r"shape \(30, 40, 3\) is no depth image"),
        (
            (50 * DEPTHS).astype(np.uint8),
            r"uint8 and shape \(120, 160\) is no depth image; pass one channel of 16 bits",
        ),
        (DEPTHS / DEPTHS.max(), "end at 1, as in a z-buffer"),
        (
            np.round(255 * DEPTHS / DEPTHS.max()).astype(np.uint16),
            "end at 255, the largest of 8 bits, as .* --depth-scale 1000",
        ),
        (
            16 * (900 + np.arange(1200).reshape(30, 40) // 60).astype(np.uint16),
            "no lowest three bits but 0, as",
        ),
        (np.full((30, 40), 1500, np.uint16), "all 1200 pixels lie at 1.5 m"),
        (
            1000 * DEPTHS,
            "the median depth is 2.* m with 1 units per metre; pass the camera's --depth-scale",
        ),
        (np.round(DEPTHS).astype(np.uint16), "the median depth is 0.002 m with 1000 units"),
    ],
)
def test_each_fault_of_depths_is_named(values: np.ndarray, said: str) -> None:
    with pytest.raises(DepthError, match=said):
        in_metres(values)
    for scale in (0, -1, np.nan):
        with pytest.raises(DepthError, match="invalid depth scale"):
            in_metres(MILLIMETRES, scale)


def test_bits_of_confidence_above_the_depth_are_named_and_far_depths_are_not() -> None:
    random = np.random.default_rng(0)
    confident = (MILLIMETRES + 8192 * random.integers(8, size=MILLIMETRES.shape)).astype(np.uint16)
    with pytest.raises(DepthError, match="as in Android's DEPTH16: 13 bits are the depth, 3 a"):
        in_metres(confident)
    np.testing.assert_allclose(in_metres(confident % 8192)[1:], DEPTHS[1:], atol=1e-6)
    far = np.linspace(6000, 12003, 120 * 160).reshape(120, 160).astype(np.uint16)
    np.testing.assert_array_equal(in_metres(far), far / 1000)
    far[:, 80:] += 9000
    np.testing.assert_array_equal(in_metres(far), far / 1000)  # a room and what lies behind it


def test_masks_and_colours_are_no_depth_images_and_a_damaged_image_is_a_lost_shape(
    tmp_path: Path,
) -> None:
    for name in (
        "0_mask",
        "MASK",
        "0.masks",
        "mask3",
        "depthMask2",
        "unmasked",
        "damask",
        "Unmasked",
    ):
        np.save(tmp_path / f"{name}.npy", MILLIMETRES)
        assert is_depth_file(tmp_path / f"{name}.npy") is (
            name in ("unmasked", "damask", "Unmasked")
        )
    for name, expected in (("colours", False), ("empty", True), ("truncated", True)):
        assert is_depth_file(INPUTS / "bad-images" / f"{name}.png") is expected


# --- masks
# ------------------------------------------------------------------------------------------------

MASK = np.zeros((6, 8), dtype=np.uint8)
MASK[2:5, 3:6] = 255
CLEAR = np.dstack([np.full((6, 8, 3), 255, np.uint8), MASK])


@pytest.mark.parametrize("mode", ["1", "RGB", "LA", "I;16", "RGBA"])
def test_what_is_neither_black_nor_transparent_is_the_object(tmp_path: Path, mode: str) -> None:
    images = {"I;16": Image.fromarray(MASK.astype(np.uint16)), "RGBA": Image.fromarray(CLEAR)}
    (images.get(mode) or Image.fromarray(MASK).convert(mode)).save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), MASK > 0)
    (tmp_path / "noise.png").write_bytes(b"mask")
    with pytest.raises(
        DepthError, match=r"noise\.png: not a readable mask: .*; pass a PNG that is white"
    ):
        read_mask(tmp_path / "noise.png")


def painted(levels: dict[int, tuple[slice, slice]], size: tuple[int, ...] = (60, 80)) -> np.ndarray:
    image = np.zeros(size, dtype=np.uint8)
    for level, place in levels.items():
        image[place] = level
    return image


DISC, HALF = np.s_[20:50, 20:60], np.s_[20:50, 20:40]
NOISE = np.random.default_rng(0).integers(0, 99, (60, 80, 3)).astype(np.uint8)


def saved(mask: np.ndarray, quality: int) -> np.ndarray:
    """Return a mask after it was saved as JPEG."""
    stream = io.BytesIO()
    Image.fromarray(mask).save(stream, "JPEG", quality=quality)
    return np.array(Image.open(stream))


@pytest.mark.parametrize(
    "mask",
    [
        *(painted({level: DISC}) for level in (1, 38, 128, 255)),
        painted({255: DISC}) / 255,
        painted({255: DISC}).astype(bool),
        *(saved(painted({255: DISC}), quality) for quality in (50, 75, 95)),
        np.where(painted({1: DISC})[..., None], [128, 0, 0], 0).astype(np.uint8),
        np.dstack([NOISE, painted({255: DISC})]),  # a photograph, cut out
    ],
)
def test_a_mask_of_one_object_is_read_whatever_marks_it(tmp_path: Path, mask: np.ndarray) -> None:
    seen = np.ones((60, 80), dtype=bool)
    if mask.dtype == np.uint8:
        Image.fromarray(mask).save(tmp_path / "mask.png")
        np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), painted({1: DISC}) > 0)
    np.testing.assert_array_equal(checked_mask(mask, seen), painted({1: DISC}) > 0)


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64, np.float32])
def test_a_mask_is_read_from_an_array(tmp_path: Path, kind: type) -> None:
    mask = painted({1: DISC})
    np.save(tmp_path / "0_mask.npy", mask.astype(kind))
    np.savez(tmp_path / "1_mask.npz", mask.astype(kind))
    np.savez(tmp_path / "2_mask.npz", mask=mask.astype(kind), depth=np.ones(3))
    for file in tmp_path.iterdir():
        np.testing.assert_array_equal(read_mask(file), mask > 0)


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.array([["a"]]), "an array of <U1 and shape .1, 1. is no mask; pass booleans"),
        (np.ones((9, 9, 2)), "an array of float64 and shape .9, 9, 2. is no mask; pass booleans"),
        (np.ones((1, 9, 9), bool), "an array of bool and shape .1, 9, 9. is no mask"),
        (np.ones(5), "an array of float64 and shape .5,. is no mask"),
        (np.zeros((4097, 1), dtype=bool), "1 x 4097 pixels are more than"),
        (np.arange(12.0).reshape(3, 4), "the mask holds 1, 2, 3, 4 ..., not one object"),
        (np.array([[0, np.nan], [1, 1]]), "the mask holds 1, nan, not one object"),
        (np.array([[None]]), "not a readable mask: it holds objects of Python"),
    ],
)
def test_an_array_that_is_no_mask_is_named(tmp_path: Path, array: np.ndarray, said: str) -> None:
    np.save(tmp_path / "0_mask.npy", array, allow_pickle=True)
    with pytest.raises(DepthError, match=rf"0_mask\.npy: {said}"):
        read_mask(tmp_path / "0_mask.npy")


@pytest.mark.parametrize(
    "mask",
    [
        *(
            painted({low: DISC, high: HALF})
            for low, high in ((1, 2), (128, 255), (24, 255), (254, 255))
        ),
        painted({255: DISC, 1: np.s_[30:40, 30:50]}),  # a border that is void
        *(np.linspace(0, top, 4800).reshape(60, 80) for top in (1, 255)),  # probabilities
        np.dstack([painted({200: DISC}), painted({200: HALF}), painted({})]),
        painted({1: DISC}) + 1,
    ],
)
def test_a_mask_of_several_values_is_refused(mask: np.ndarray) -> None:
    with pytest.raises(
        DepthError, match="the mask holds .*, not one object; write the pixels of the object alone"
    ):
        checked_mask(mask, np.ones((60, 80), dtype=bool))


@pytest.mark.parametrize(
    ("image", "mask"),
    [
        ("a/0.png", "a/0.mask.png"),
        ("a/frame-1.depth.png", "a/frame-1.mask.png"),
        ("a/depth/0.png", "a/mask/0.png"),
        ("a/depth/000.png", "a/masks/000_shirt.png"),
        ("a/0.npy", "a/0_MASK.PNG"),
        ("a/0.png", "a/0_mask.jpg"),
        ("a/0.png", "a/0-masks-1.tif"),
        ("a/depth/0.png", "a/mask/0.npy"),
        ("a/depth/0.png", "a/Masks/0.jpg"),
        ("a/0.png", "a/mask_0.png"),
        ("a/depth_0.png", "a/mask_0.png"),
        ("a/depth_0.png", "a/0_mask.png"),
        ("a/depth/depth_0.png", "a/masks/mask_0.png"),
        ("b/cat/0.png", "b/masks/cat/0.png"),
        ("b/depth/cat/0.png", "b/masks/cat/0.png"),
    ],
)
def test_masks_are_found_by_their_usual_names_and_several_are_refused(
    tmp_path: Path, image: str, mask: str
) -> None:
    for name in (image, mask, "a/depth/7.png", "a/mask/7_shirt.png", "a/mask/7_man.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert find_mask(tmp_path / image) == tmp_path / mask
    (tmp_path / "a/depth/00_mask.png").write_text("")
    assert find_mask(tmp_path / "a/1.png") is None
    with pytest.raises(
        DepthError, match="7.png: it has the masks mask/7_man.png and mask/7_shirt.png; keep"
    ):
        find_mask(tmp_path / "a/depth/7.png")
    for number in range(2):
        (tmp_path / f"a/5_mask_{number}.png").write_text("")
    with pytest.raises(
        DepthError, match="5.png: it has the masks 5_mask_0.png and 5_mask_1.png; keep that of"
    ):
        find_mask(tmp_path / "a/5.png")


@pytest.mark.parametrize(
    ("image", "masks"),
    [
        ("set/cat/1.png", ("cat/1_mask.png", "masks/cat/1.png")),
        ("set/depth/cat/1.png", ("depth/cat/1_mask.png", "masks/cat/1.png")),
        ("set/cat/1.png", ("cat/mask/1.png", "mask/cat/1.png")),
        ("set/depth/1.png", ("depth/1_mask.png", "mask/1.png")),
        ("set/1.png", ("1_mask.png", "mask/1.png")),
    ],
)
def test_masks_of_two_places_are_named_from_the_folder_that_holds_both(
    tmp_path: Path, image: str, masks: tuple[str, str]
) -> None:
    for name in (image, *(f"set/{mask}" for mask in masks)):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    with pytest.raises(DepthError) as caught:
        find_mask(tmp_path / image)
    assert f"1.png: it has the masks {masks[0]} and {masks[1]}; keep" in str(caught.value)


@pytest.mark.parametrize(
    ("others", "mask"),
    [
        (["a_1.tif"], "a_1.png"),
        (["a_1_depth.png"], "a_1.png"),
        (["a_1.png"], "a_1_mask.png"),
        (["a_1.png"], "a_1_man.png"),
    ],
)
def test_a_mask_belongs_to_the_image_whose_name_it_has_in_full(
    tmp_path: Path, others: list[str], mask: str
) -> None:
    (tmp_path / "masks").mkdir()
    for name in ("a.png", "a_depth.png", f"masks/{mask}"):
        (tmp_path / name).write_text("")
    for image in ("a.png", "a_depth.png"):
        assert find_mask(tmp_path / image) == tmp_path / "masks" / mask
    for name in others:
        (tmp_path / name).write_text("")
        assert find_mask(tmp_path / name) == tmp_path / "masks" / mask
    for image in ("a.png", "a_depth.png"):
        assert find_mask(tmp_path / image) is None


def test_a_mask_is_found_from_the_folder_of_its_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks/0.png").write_text("")
    monkeypatch.chdir(tmp_path)
    assert find_mask(Path("0.png")) == tmp_path / "masks/0.png"


# --- intrinsics
# ------------------------------------------------------------------------------------------------

SIZE = (640, 480)
K = [525, 0, 319.5, 0, 526, 239.5, 0, 0, 1]
LENS = (0.1, -0.25, 0.001, -0.002, 0.0)
REALSENSE = {"width": 640, "height": 480, "fx": 525, "fy": 526, "ppx": 319.5, "ppy": 239.5}
#: Files that hold these numbers: a name, the size or none, and whether the lens distorts.
CAMERAS = [line.split("  ") for line in (INPUTS / "cameras.txt").read_text().splitlines()]
#: Files that are refused: a name, and what the error says.
BAD_CAMERAS = dict(
    line.split("  ", 1) for line in (INPUTS / "bad-cameras.txt").read_text().splitlines()
)


def test_each_camera_is_listed() -> None:
    for folder, listed in (
        ("cameras", {name for name, *_ in CAMERAS}),
        ("bad-cameras", BAD_CAMERAS.keys()),
    ):
        assert {path.name for path in (INPUTS / folder).iterdir()} == listed


@pytest.mark.parametrize(("name", "size", "lens"), CAMERAS)
def test_every_way_to_write_intrinsics_says_the_same(name: str, size: str, lens: str) -> None:
    read = read_intrinsics(INPUTS / "cameras" / name)
    assert (read.fx, read.fy, read.cx, read.cy) == (525, 526, 319.5, 239.5)
    assert read.size == (SIZE if size == "640 480" else None)
    zeros = (0.0,) * 8
    assert (*read.distortion, *zeros)[:8] == (*(LENS if lens == "distorted" else ()), *zeros)[:8]


@pytest.mark.parametrize(
    "coefficients",
    [
        (0.1, -0.25, 0.001, -0.002),
        (-0.3, 0.1, 0, 0, 0.01),
        (0.5, -2.6, 0.001, 0, 1.5, 0.4, -2.4, 1.4),
    ],
)
def test_rays_of_a_distorted_camera_are_those_of_opencv(coefficients: tuple[float, ...]) -> None:
    """Distorting the rays again gives the pixels."""
    rays = (
        Intrinsics(525, 526, 319.5, 239.5, SIZE, coefficients).rays(*SIZE)[::7, ::7].reshape(-1, 2)
    )
    points, zero = np.c_[rays, np.ones(len(rays))], np.zeros(3)
    seen, _ = cv2.projectPoints(
        points, zero, zero, np.array(K, dtype=float).reshape(3, 3), np.array(coefficients)
    )
    u, v = np.meshgrid(np.arange(0, 640, 7.0), np.arange(0, 480, 7.0))
    np.testing.assert_allclose(seen.reshape(-1, 2), np.c_[u.ravel(), v.ravel()], atol=1e-3)


@pytest.mark.parametrize("focal_length", [560, 300, 200])
def test_a_distortion_that_no_ray_has_at_the_corners_is_refused(focal_length: float) -> None:
    """With this lens, no ray appears farther from the middle than 0.703 focal lengths."""
    with pytest.raises(
        DepthError, match=r"distortion \(-0\.3, 0.* cannot be inverted on this imag"
    ):
        Intrinsics(focal_length, focal_length, 319.5, 239.5, SIZE, (-0.3, 0, 0, 0)).rays(*SIZE)


def test_a_wide_lens_whose_steepest_rays_are_found_slowly_is_no_fault() -> None:
    """As that of an Azure Kinect, whose images in the wide mode are 1024 pixels wide."""
    lens = (5.34, 3.5, -2e-5, 9e-5, 0.18, 5.67, 5.23, 0.92)
    rays = Intrinsics(504, 504, 516, 518, (1024, 1024), lens).rays(1024, 1024)
    assert 3.5 < np.abs(rays).max() < 3.7


@pytest.mark.parametrize("name", BAD_CAMERAS)
def test_each_fault_of_intrinsics_is_named_in_one_line_with_a_hint(name: str) -> None:
    path = INPUTS / "bad-cameras" / name
    with pytest.raises(DepthError, match=BAD_CAMERAS[name]) as caught:
        read_intrinsics(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.hint


CAMERA = REALSENSE | {"fx": 130, "fy": 130, "ppx": 79.5, "ppy": 59.5, "width": 160, "height": 120}
THERE = np.where(OBJECT, np.linspace(1.9, 2.3, 160), 0)


@pytest.mark.parametrize(
    ("factor", "kind", "stated"),
    [
        *(
            (1000, "i4", {"depth_scale": value})
            for value in (1000, 0.001, 1.0, "mm", "millimetres")
        ),
        *(
            (1000, "i4", {key: value})
            for key, value in (("depthUnits", 0.001), ("depth_unit", "mm"))
        ),
        *((1, "f4", {"depth_scale": value}) for value in (1000, 1, "m")),
        (1000, "f4", {"depth_scale": "mm"}),
    ],
)
def test_a_depth_scale_of_a_camera_file_is_a_unit_or_agrees_with_the_type(
    tmp_path: Path, factor, kind, stated
) -> None:
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA | stated))
    values = np.round(factor * THERE, 3).astype(kind)
    depths = in_metres(values, scale_of(values, read_intrinsics(tmp_path / "camera.json")))
    np.testing.assert_allclose(depths[OBJECT], THERE[OBJECT], atol=1e-3)


@pytest.mark.parametrize("name", ["orb-slam", "orb-slam-3"])
def test_the_depth_scale_of_orb_slam_is_in_units_per_metre(name: str) -> None:
    camera = read_intrinsics(INPUTS / "cameras" / name)
    values = np.round(5000 * THERE).astype(np.uint16)
    depths = in_metres(values, scale_of(values, camera))
    np.testing.assert_allclose(depths[OBJECT], THERE[OBJECT], atol=1e-3)


def test_any_other_depth_scale_is_refused_unless_the_units_are_passed(tmp_path: Path) -> None:
    file, image = tmp_path / "camera.json", tmp_path / "depth.npy"
    np.save(image, np.round(5000 * THERE).astype(np.uint16))
    for stated, said in (
        (5000, "may mean 5000 or 0.0002 or 0.2 units per metre; pass"),
        (0.2, "0.2 or 5 or 5000 un"),
    ):
        file.write_text(json.dumps(CAMERA | {"depth_scale": stated}))
        for camera in (None, Intrinsics(130, 130, 79.5, 59.5)):
            with pytest.raises(DepthError, match=said):
                FrameFiles(image, camera).observe()
            assert FrameFiles(image, camera, scale=5000).observe().notes[
                "distance"
            ] == pytest.approx(2.1, abs=0.05)


def test_without_a_size_the_centre_lies_in_the_middle_and_numbers_are_no_file() -> None:
    with pytest.raises(DepthError, match="far from the middle"):
        Intrinsics(1050, 1050, 639.5, 479.5).check_size(*SIZE)
    for width, height in ((480, 640), (720, 1280), (1024, 1280)):  # of frames that were turned
        with pytest.raises(DepthError, match="far from the middle .* not of one turned"):
            Intrinsics(525, 525, height / 2, width / 2).check_size(width, height)
    Intrinsics(525, 525, -0.5, 479.5, SIZE).check_size(*SIZE)  # a part of a larger image
    with pytest.raises(
        DepthError, match="focal lengths 0.82, 1.09 are implausible for 640 x 480 pixels"
    ):
        Intrinsics(0.82, 1.09, 0.5, 0.5, SIZE).check_size(*SIZE)
    assert intrinsics_of("525,526,319.5,239.5") == Intrinsics(525, 526, 319.5, 239.5)
    with pytest.raises(DepthError, match=r"absent\.json: No such file"):
        intrinsics_of("absent.json")


@pytest.mark.parametrize(
    ("image", "files"),
    [
        ("a/b/0.png", ["a/intrinsics.txt", "camera.json"]),
        ("a/b/0.png", ["camera_info.yaml"]),
        ("a/frame-000.depth.png", ["a/depthIntrinsics.txt"]),
        ("a/frame-000.depth.png", ["a/camera_depth.json"]),
    ],
)
def test_intrinsics_are_found_by_their_usual_names_the_nearest_first(
    tmp_path: Path, image: str, files: list[str]
) -> None:
    for name in (image, *files):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert find_intrinsics(tmp_path / image) == tmp_path / files[0]
    for name in ("camera_color.json", "K.txt"):
        (tmp_path / files[0]).with_name(name).write_text("")
    with pytest.raises(
        DepthError,
        match=f"two camera files are near it, K.txt and {Path(files[0]).name}; keep that of",
    ):
        find_intrinsics(tmp_path / image)


def test_of_two_camera_files_the_one_that_is_named_is_enough_if_it_states_the_units(
    tmp_path: Path,
) -> None:
    image = tmp_path / "0.npy"
    np.save(image, np.round(1000 * THERE).astype(np.uint16))
    for name in ("camera.json", "camera_depth.json"):
        (tmp_path / name).write_text(json.dumps(CAMERA | {"depth_scale": "mm"}))
    named = FrameFiles(image, read_intrinsics(tmp_path / "camera.json"))
    assert named.intrinsics_file is None
    assert named.observe().notes["unit"] == "1 / 1000 m"
    numbers = FrameFiles(image, Intrinsics(130, 130, 79.5, 59.5))
    with pytest.raises(DepthError, match="name it, and the units .* --depth-scale UNITS"):
        numbers.observe()
    assert replace(numbers, scale=1000).observe().notes["unit"] == "1 / 1000 m"


def test_numbers_may_be_longer_than_the_name_of_a_file(tmp_path: Path) -> None:
    matrix = ",".join(f"{number:.30f}" for number in K)
    assert intrinsics_of(matrix, tmp_path) == Intrinsics(525, 526, 319.5, 239.5)

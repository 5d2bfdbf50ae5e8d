"""Intrinsics: every way to write them says the same, and distortion agrees with OpenCV."""

import json

import cv2
import numpy as np
import pytest

from benchmark.depth.errors import InvalidIntrinsics
from benchmark.depth.intrinsics import Intrinsics, find_intrinsics, intrinsics_of, read_intrinsics

MATRIX = "525.0 0 319.5\n0 526.0 239.5\n0 0 1\n"
SIZE = (640, 480)
COLUMNS = [525.0, 0, 0, 0, 526.0, 0, 319.5, 239.5, 1]
ROS = """image_width: 640
image_height: 480
camera_name: depth
camera_matrix:
  rows: 3
  cols: 3
  data: [525.0, 0.0, 319.5,
         0.0, 526.0, 239.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [DISTORTION]
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""
ECHOED = "height: 480\nwidth: 640\nD: [0.0, 0.0, 0.0, 0.0, 0.0]\nK: [525.0, 0.0, 319.5, 0.0, 526.0, 239.5, 0, 0, 1]\n"
OPEN3D = {"width": 640, "height": 480, "intrinsic_matrix": COLUMNS}
WRITTEN = {
    "three rows": (MATRIX, None),
    "four numbers": ("525 526 319.5 239.5", None),
    "open3d": (json.dumps(OPEN3D), SIZE),
    "realsense": ('{"width":640,"height":480,"fx":525,"fy":526,"ppx":319.5,"ppy":239.5}', SIZE),
    "ros": (ROS.replace("DISTORTION", "0, 0, 0, 0, 0"), SIZE),
    "ros echoed": (ECHOED, SIZE),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_every_way_to_write_them_says_the_same(tmp_path, how):
    text, size = WRITTEN[how]
    (tmp_path / "camera").write_text(text)
    assert read_intrinsics(tmp_path / "camera") == Intrinsics(525, 526, 319.5, 239.5, size)


def test_four_numbers_on_the_command_line_are_no_file():
    assert intrinsics_of("525,526,319.5,239.5") == Intrinsics(525, 526, 319.5, 239.5)
    with pytest.raises(InvalidIntrinsics, match="absent.json: No such file"):
        intrinsics_of("absent.json")


@pytest.mark.parametrize(
    "coefficients", [(0.1, -0.25, 0.001, -0.002), (-0.3, 0.1, 0, 0, 0.01), (0.5, -2.6, 0.001, 0, 1.5, 0.4, -2.4, 1.4)]
)
def test_rays_of_a_distorted_camera_are_those_of_opencv(tmp_path, coefficients):
    (tmp_path / "camera_info.yaml").write_text(
        ROS.replace("DISTORTION", ", ".join(map(str, coefficients))).replace(
            "plumb_bob", "rational_polynomial" if len(coefficients) == 8 else "plumb_bob"
        )
    )
    rays = read_intrinsics(tmp_path / "camera_info.yaml").rays(*SIZE)
    u, v = np.meshgrid(np.arange(0, 640, 7.0), np.arange(0, 480, 7.0))
    matrix = np.array([[525.0, 0, 319.5], [0, 526, 239.5], [0, 0, 1]])
    # What is true of an inverse: distorting the rays again gives the pixels.
    directions = rays[::7, ::7].reshape(-1, 2)
    seen = cv2.projectPoints(
        np.c_[directions, np.ones(len(directions))], np.zeros(3), np.zeros(3), matrix, np.array(coefficients)
    )
    np.testing.assert_allclose(seen[0].reshape(-1, 2), np.c_[u.ravel(), v.ravel()], atol=1e-3)


REALSENSE = {"width": 640, "height": 480, "fx": 525, "fy": 526, "ppx": 319.5, "ppy": 239.5}
CAMERA_INFO = {"K": [525, 0, 319.5, 0, 526, 239.5, 0, 0, 1], "height": 480, "width": 640}
LENS = (0.1, -0.25, 0.001, -0.002, 0.0)


@pytest.mark.parametrize(
    "content",
    [
        REALSENSE | {"model": "distortion.brown_conrady", "coeffs": LENS},
        REALSENSE | dict(zip(("k1", "k2", "p1", "p2", "k3"), LENS, strict=True)),
        CAMERA_INFO | {"distortion_model": "plumb_bob", "D": LENS},
        OPEN3D | {"distortion": [[value] for value in LENS]},
        {"intrinsic": [[525, 0, 319.5], [0, 526, 239.5], [0, 0, 1]], "D": LENS, "width": 640, "height": 480},
        ROS.replace("DISTORTION", ", ".join(map(str, LENS))),
        ECHOED.replace("0.0, 0.0, 0.0, 0.0, 0.0", ", ".join(map(str, LENS))),
    ],
)
def test_distortion_is_read_from_every_kind_of_file(tmp_path, content):
    (tmp_path / "camera").write_text(content if isinstance(content, str) else json.dumps(content))
    read = read_intrinsics(tmp_path / "camera")
    assert (read.fx, read.cy, read.size) == (525, 239.5, SIZE)
    assert (*read.distortion, 0.0, 0.0, 0.0)[:8] == (*LENS, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("zeros", [True, False])
@pytest.mark.parametrize("model", ["equidistant", "Kannala Brandt4", "distortion.ftheta"])
@pytest.mark.parametrize("kind", ["json", "realsense", "yaml"])
def test_a_lens_that_is_no_pinhole_is_refused_by_name(tmp_path, kind, model, zeros):
    lens = [0.0] * 4 if zeros else [0.1, 0.2, 0.3, 0.4]
    text = {
        "json": json.dumps(CAMERA_INFO | {"distortion_model": model, "D": lens}),
        "realsense": json.dumps(REALSENSE | {"model": model, "coeffs": lens}),
        "yaml": ROS.replace("DISTORTION", ", ".join(map(str, lens))).replace("plumb_bob", model),
    }[kind]
    (tmp_path / "camera").write_text(text)
    with pytest.raises(InvalidIntrinsics, match=f"the distortion model is '{model}'; rectify the image"):
        read_intrinsics(tmp_path / "camera")


@pytest.mark.parametrize("model", ["Inverse Brown Conrady", "distortion.modified_brown_conrady", "none", "thin_prism"])
def test_another_model_counts_only_where_it_bends_something(tmp_path, model):
    (tmp_path / "camera").write_text(json.dumps(REALSENSE | {"model": model, "coeffs": [0.0] * 5}))
    assert read_intrinsics(tmp_path / "camera") == Intrinsics(525, 526, 319.5, 239.5, SIZE)
    (tmp_path / "camera").write_text(json.dumps(REALSENSE | {"model": model, "coeffs": LENS}))
    with pytest.raises(InvalidIntrinsics, match=f"the distortion model is '{model}'"):
        read_intrinsics(tmp_path / "camera")


BAD = {
    "singular": ("0 0 319.5\n0 525 239.5\n0 0 1", "focal lengths 0, 525 .* are those of no camera"),
    "words": ("camera of mine", "is no list of numbers"),
    "nan": ("nan 0 3 0 1 2 0 0 1", "the matrix"),
    "json": ('{"width": 640}', "keys width name no principal point"),
    "huge": ("1" * 2_000_000, "too large"),
}


@pytest.mark.parametrize("fault", BAD)
def test_each_fault_is_named(tmp_path, fault):
    text, said = BAD[fault]
    (tmp_path / "camera").write_text(text)
    with pytest.raises(InvalidIntrinsics, match=said) as caught:
        read_intrinsics(tmp_path / "camera")
    assert str(tmp_path / "camera") in caught.value.problem


def test_an_image_is_no_intrinsics(tmp_path):
    (tmp_path / "depth.png").write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(InvalidIntrinsics, match="is no text, as an image is none; write a 3 x 3 matrix"):
        read_intrinsics(tmp_path / "depth.png")


def test_those_of_another_size_are_refused():
    with pytest.raises(InvalidIntrinsics, match="those of 1280 x 960 pixels, the image has 640 x 480"):
        Intrinsics(1050, 1050, 640, 480, (1280, 960)).check_size(*SIZE)
    with pytest.raises(InvalidIntrinsics, match="far from the middle"):
        Intrinsics(1050, 1050, 639.5, 479.5).check_size(*SIZE)
    Intrinsics(525, 525, 600, 100, SIZE).check_size(*SIZE)  # a part of a larger image


@pytest.mark.parametrize(
    ("image", "file"),
    [
        ("a/b/0.png", "a/intrinsics.txt"),
        ("a/b/0.png", "camera_info.yaml"),
        ("a/frame-000.depth.png", "a/depthIntrinsics.txt"),
        ("a/0.depth.png", "a/0_camera.json"),
    ],
)
def test_they_are_found_by_their_usual_names(tmp_path, image, file):
    for name in (image, file):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert find_intrinsics(tmp_path / image) == tmp_path / file


def test_its_own_come_before_those_of_the_folder(tmp_path):
    for name in ("0.png", "camera.json", "0_intrinsics.txt"):
        (tmp_path / name).write_text("")
    assert find_intrinsics(tmp_path / "0.png") == tmp_path / "0_intrinsics.txt"
    assert find_intrinsics(tmp_path / "1.png") == tmp_path / "camera.json"

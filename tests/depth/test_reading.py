"""Depth images in files: every kind says the same, and every fault has a name."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from benchmark.depth.errors import DepthError, InvalidDepth, UnreadableDepth
from benchmark.depth.reading import in_metres, is_depth_file, read_depth

DEPTHS = np.linspace(0.5, 4.0, 30 * 40).reshape(30, 40).round(3)
DEPTHS[0, :5] = 0
MILLIMETRES = np.round(1000 * DEPTHS).astype(np.uint16)


def pfm(values, order="<"):
    return (
        b"Pf\n%d %d\n%s\n" % (*values.shape[::-1], b"-1.0" if order == "<" else b"1.0")
        + values[::-1].astype(f"{order}f4").tobytes()
    )


def write(path, kind):
    path = path / f"depth.{kind.split()[-1]}"
    floats = DEPTHS.astype(np.float32)
    match kind:
        case "png" | "tiff":
            Image.fromarray(MILLIMETRES).save(path)
        case "float tif":
            Image.fromarray(floats).save(path)
        case "npy":
            np.save(path, floats)
        case "integer npy":
            np.save(path, MILLIMETRES.astype(np.int32))
        case "npz":
            np.savez_compressed(path, depth=floats, other=np.zeros(3))
        case "single npz":
            np.savez(path, frame=floats)
        case "pfm":
            path.write_bytes(pfm(floats))
        case "big pfm":
            path.write_bytes(pfm(floats, ">"))
    return path


KINDS = ("png", "tiff", "float tif", "npy", "integer npy", "npz", "single npz", "pfm", "big pfm")


@pytest.mark.parametrize("kind", KINDS)
def test_all_kinds_of_files_say_the_same(tmp_path, kind):
    path = write(tmp_path, kind)
    np.testing.assert_allclose(read_depth(path), DEPTHS, atol=1e-6)
    assert is_depth_file(path)


def test_what_is_no_positive_number_was_not_seen():
    values = DEPTHS.copy()
    values[1, :4] = np.nan, np.inf, -np.inf, -2
    depth = in_metres(values)
    assert not depth[1, :4].any()
    np.testing.assert_array_equal(depth[2:], DEPTHS[2:])


def png_of(width, height):
    """A PNG of 16 bits that claims a size and holds next to nothing."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(10000))) + chunk(b"IEND", b"")


def npy_of(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def whole_png(tmp_path):
    return write(tmp_path, "png").read_bytes()


def encoded(image):
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


BAD = {
    "truncated": ("png", lambda t: whole_png(t)[:-200], UnreadableDepth, "not a readable png file"),
    "8 bits": ("png", lambda t: encoded(Image.new("L", (40, 30), 9)), UnreadableDepth, "holds 8 bits.*16 bits"),
    "large": ("png", lambda t: png_of(8000, 6000), UnreadableDepth, "8000 x 6000 pixels are more than 4096"),
    "bomb": ("png", lambda t: png_of(60000, 60000), UnreadableDepth, "more pixels than any depth camera"),
    "short array": ("npy", lambda t: npy_of((400, 400)), UnreadableDepth, "not a readable npy file"),
    "short map": ("pfm", lambda t: pfm(DEPTHS)[:-8], UnreadableDepth, "ends after 1198 of 1200 pixels"),
    "jpeg": ("jpg", lambda t: b"", UnreadableDepth, "unknown extension '.jpg'; convert it to one of .png"),
    "absent": ("png", None, UnreadableDepth, "No such file"),
}


@pytest.mark.parametrize("fault", BAD)
def test_each_fault_of_a_file_is_named(tmp_path, fault):
    ending, made, kind, said = BAD[fault]
    path = tmp_path / f"bad.{ending}"
    if made:
        path.write_bytes(made(tmp_path))
    with pytest.raises(kind, match=said) as caught:
        read_depth(path)
    assert str(path) in caught.value.problem
    assert caught.value.hint


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.ones((2, 2)), "4 of 4 pixels have a depth, fewer than 200"),
        (np.full((30, 40), 1500, np.uint16), "all 1200 pixels lie at 1.5 m"),
        (1000 * DEPTHS, "the median depth is 2.* m with 1 units per metre; pass the camera's --depth-scale"),
        (np.round(DEPTHS).astype(np.uint16), "the median depth is 0.002 m with 1000 units"),
        (np.zeros((30, 40, 3)), "shape .30, 40, 3. is no depth image"),
    ],
)
def test_each_fault_of_depths_is_named(values, said):
    with pytest.raises(InvalidDepth, match=said):
        in_metres(values)
    for scale in (0, -1, np.nan):
        with pytest.raises(DepthError):
            in_metres(MILLIMETRES, scale)


@pytest.mark.parametrize(
    ("name", "is_mask"),
    [("unmasked", False), ("masked", False), ("damask", False), ("0_mask", True), ("MASK", True), ("0.masks", True),
     ("mask3", True), ("depthMask", True), ("depthMask2", True), ("Mask", True), ("Unmasked", False)],
)  # fmt: skip
def test_a_mask_has_the_word_in_its_name(tmp_path, name, is_mask):
    np.save(tmp_path / f"{name}.npy", MILLIMETRES)
    assert is_depth_file(tmp_path / f"{name}.npy") is not is_mask


def test_masks_and_colours_are_no_depth_images(tmp_path):
    for name, image in (
        ("a_mask.png", Image.fromarray(MILLIMETRES)),
        ("colour.png", Image.new("RGB", (40, 30))),
        ("grey.png", Image.new("L", (40, 30))),
    ):
        image.save(tmp_path / name)
        assert not is_depth_file(tmp_path / name)
    (tmp_path / "cut.png").write_bytes(whole_png(tmp_path)[:-200])
    assert is_depth_file(tmp_path / "cut.png"), "a damaged depth image is a shape that is lost, not one that is ignored"

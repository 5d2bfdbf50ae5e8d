"""Masks: what is white, and where they are found."""

import numpy as np
import pytest
from PIL import Image

from benchmark.depth.errors import InvalidMask
from benchmark.depth.reading import find_mask, read_mask

MASK = np.zeros((6, 8), dtype=np.uint8)
MASK[2:5, 3:6] = 255


@pytest.mark.parametrize("mode", ["1", "RGB", "LA", "I;16"])
def test_what_is_not_black_is_the_object(tmp_path, mode):
    image = Image.fromarray(MASK.astype(np.uint16)) if mode == "I;16" else Image.fromarray(MASK).convert(mode)
    image.save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), MASK > 0)


def test_what_is_transparent_is_not(tmp_path):
    white = np.full((6, 8, 4), 255, np.uint8)
    white[..., 3] = MASK
    Image.fromarray(white).save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), MASK > 0)


@pytest.mark.parametrize(
    ("image", "mask"),
    [
        ("a/0.png", "a/0.mask.png"),
        ("a/frame-1.depth.png", "a/frame-1.mask.png"),
        ("a/depth/0.png", "a/mask/0.png"),
        ("a/depth/000.png", "a/mask/000_shirt.png"),
    ],
)
def test_masks_are_found_by_their_usual_names(tmp_path, image, mask):
    for name in (image, mask):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert find_mask(tmp_path / image) == tmp_path / mask
    assert find_mask(tmp_path / "a" / "1.png") is None


def test_of_several_masks_none_is_taken(tmp_path):
    (tmp_path / "mask").mkdir()
    for name in ("0.png", "mask/0_shirt.png", "mask/0_man.png"):
        (tmp_path / name).write_text("")
    assert find_mask(tmp_path / "0.png") is None


def test_what_is_no_image_is_named(tmp_path):
    (tmp_path / "mask.png").write_bytes(b"mask")
    for name in ("mask.png", "absent.png"):
        with pytest.raises(InvalidMask, match=f"{name} is no readable mask: .*; pass a PNG that is white"):
            read_mask(tmp_path / name)

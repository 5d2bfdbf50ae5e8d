"""Depth images in, canonical forms out, from Python."""

import numpy as np
import pytest

from benchmark import canonical_form_of_depth
from benchmark.commands.forms import method_of_depth
from benchmark.errors import ConfigurationError, DepthError
from tests.depth.scenes import SMALL_CAMERA, in_millimetres, small_frame

CAMERA = np.array([[262.5, 0, 159.75], [0, 262.5, 119.75], [0, 0, 1]])


@pytest.fixture(scope="module")
def given():
    """A frame in millimetres, the pixels of its figure, and their form."""
    depths, mask = small_frame()
    millimetres = in_millimetres(depths)
    return millimetres, mask, canonical_form_of_depth(millimetres, CAMERA, mask, "identity")


def test_a_camera_is_four_numbers_and_depths_are_millimetres(given):
    millimetres, mask, wanted = given
    camera = (262.5, 262.5, 159.75, 119.75)
    form = canonical_form_of_depth(millimetres, camera, mask, "identity")
    np.testing.assert_array_equal(form.vertices, wanted.vertices)


def test_a_camera_is_a_padded_matrix_depths_are_metres_and_a_mask_has_bytes(given):
    millimetres, mask, wanted = given
    camera, as_bytes = np.pad(CAMERA, (0, 1)), 255 * mask.astype(np.uint8)
    form = canonical_form_of_depth(millimetres / 1000, camera, as_bytes, "identity")
    np.testing.assert_array_equal(form.vertices, wanted.vertices)


def test_a_camera_is_an_object_and_depths_have_a_scale(given):
    millimetres, mask, wanted = given
    fifths = 5 * millimetres.astype(np.int32)
    form = canonical_form_of_depth(fifths, SMALL_CAMERA, mask, "identity", scale=5000)
    np.testing.assert_array_equal(form.vertices, wanted.vertices)


def test_the_method_is_by_default_the_network_that_a_loop_loads_once():
    form = canonical_form_of_depth(small_frame()[0], CAMERA)
    assert (form.notes["mask"], form.notes["up"], form.notes["predicted_pieces"]) == (
        "found",
        "floor",
        1,
    )
    small = canonical_form_of_depth(0.4 * small_frame()[0], CAMERA, small_frame()[1])
    size, _ = str(small.notes["doubt"]).split(" m is small for a person")
    assert float(size) == pytest.approx(small.notes["size"], 0.02)
    assert "person" not in str(form.notes.get("doubt"))
    assert (
        "doubt"
        not in canonical_form_of_depth(
            0.4 * small_frame()[0], CAMERA, small_frame()[1], "identity"
        ).notes
    )
    assert method_of_depth("learned-streamed") is method_of_depth("learned-streamed")


@pytest.mark.parametrize(
    ("camera", "method", "message"),
    [
        (CAMERA[:2], "identity", "expected 4, 9 or 16 numbers, found 6"),
        (CAMERA, "learnt", "unknown method"),
        (CAMERA, "shape-dna", "method 'shape-dna' computes no forms"),
    ],
)
def test_what_cannot_be_used_is_named(camera, method, message):
    depths, mask = small_frame()
    with pytest.raises((ConfigurationError, DepthError), match=message):
        canonical_form_of_depth(depths, camera, mask, method)


def test_masked_pixels_have_no_reading_and_are_not_on_the_object(given):
    millimetres, mask, wanted = given
    for depths in (millimetres, millimetres / 1000):
        unread = canonical_form_of_depth(np.where(mask, depths, 0), CAMERA, None, "identity")
        frame = np.ma.masked_array(depths, ~mask)
        form = canonical_form_of_depth(frame, CAMERA, None, "identity")
        np.testing.assert_array_equal(form.vertices, unread.vertices)
    everywhere = np.ma.masked_array(np.ones(mask.shape, np.uint8), ~mask)
    form = canonical_form_of_depth(millimetres, CAMERA, everywhere, "identity")
    np.testing.assert_array_equal(form.vertices, wanted.vertices)


@pytest.mark.parametrize("kind", [bool, np.uint8, float])
@pytest.mark.parametrize("n_channels", [1, 3, 4])
def test_a_mask_has_one_channel_or_colours_of_any_type(given, kind, n_channels):
    millimetres, mask, wanted = given
    coloured = np.repeat(mask[..., np.newaxis], n_channels, axis=2).astype(kind)
    form = canonical_form_of_depth(millimetres, CAMERA, coloured, "identity")
    np.testing.assert_array_equal(form.vertices, wanted.vertices)


#: Arguments that are nothing of the kind, and what the error says.
OF_OTHER_TYPES = {
    "the text of a camera": ({"intrinsics": "262.5,262.5,159.5,119.5"}, "of type str are no num"),
    "a camera by names": ({"intrinsics": {"fx": 262.5}}, "of type dict are no numbers"),
    "complex numbers": ({"intrinsics": [1j, 1, 1, 1]}, "of type list are no numbers"),
    "a scale in text": ({"scale": "1000"}, "scale is no positive number: '1000'"),
    "two scales": ({"scale": [1000, 1000]}, "scale is no positive number"),
    "no scale": ({"scale": 0}, "scale is no positive number: 0"),
    "truth as scale": ({"scale": True}, "scale is no positive number: True"),
    "a width in text": ({"half_width": "1"}, "half_width is no positive number: '1'"),
    "no width": ({"half_width": np.nan}, "half_width is no positive number: nan"),
    "a width below zero": ({"half_width": -1.0}, "half_width is no positive number"),
    "the name of a mask": ({"mask": "mask.png"}, r"shape \(\) is no mask"),
    "a mask of two channels": ({"mask": np.ones((240, 320, 2))}, "240, 320, 2.* is no mask"),
    "a mask with the channel first": ({"mask": np.ones((1, 240, 320))}, "is no mask"),
    "a complex mask": ({"mask": np.ones((240, 320)) + 0j}, "complex128.* is no mask"),
}


@pytest.mark.parametrize("case", OF_OTHER_TYPES)
def test_arguments_of_another_type_are_named(case):
    arguments, problem = OF_OTHER_TYPES[case]
    with pytest.raises(DepthError, match=problem) as caught:
        canonical_form_of_depth(
            small_frame()[0], method="identity", **{"intrinsics": CAMERA} | arguments
        )
    assert caught.value.hint


def test_a_larger_frame_holds_larger_objects():
    depths, mask = small_frame()
    grown = canonical_form_of_depth(1.6 * depths, CAMERA, mask, "identity", half_width=2.0)
    assert grown.notes["size"] > 2.57


def test_the_former_place_of_the_function_works_and_says_what_to_write_instead():
    with pytest.warns(DeprecationWarning, match="write 'from benchmark import canonical_form"):
        from benchmark.depth_forms import canonical_form_of_depth as former
    assert former is canonical_form_of_depth
    with pytest.raises(ImportError, match="cannot import name 'nothing'"):
        from benchmark.depth_forms import nothing  # noqa: F401

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

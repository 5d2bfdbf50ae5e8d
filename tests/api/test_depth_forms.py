"""Depth images in, canonical forms out, from Python."""

import numpy as np
import pytest

from benchmark import canonical_form_of_depth
from benchmark.commands.forms import method_of_depth
from benchmark.depth.intrinsics import Intrinsics
from benchmark.errors import ConfigurationError, DepthError
from tests.depth.scenes import frame, in_millimetres

CAMERA = np.array([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]])


@pytest.mark.parametrize(
    "camera",
    [(525, 525, 319.5, 239.5), np.pad(CAMERA, (0, 1)), Intrinsics(525, 525, 319.5, 239.5)],
    ids=str,
)
def test_every_way_to_pass_a_camera_and_depths_gives_the_same(camera):
    depths, mask = frame()
    millimetres = in_millimetres(depths)
    wanted = canonical_form_of_depth(millimetres, CAMERA, mask, "identity")
    for form in (
        canonical_form_of_depth(millimetres, camera, mask, "identity"),
        canonical_form_of_depth(
            millimetres / 1000, camera, 255 * mask.astype(np.uint8), "identity"
        ),
        canonical_form_of_depth(
            5 * millimetres.astype(np.int32), camera, mask, "identity", scale=5000
        ),
    ):
        np.testing.assert_array_equal(form.vertices, wanted.vertices)


def test_the_method_is_by_default_the_network_that_a_loop_loads_once():
    form = canonical_form_of_depth(frame()[0], CAMERA)
    assert (form.notes["mask"], form.notes["up"], form.notes["predicted_pieces"]) == (
        "found",
        "floor",
        1,
    )
    small = canonical_form_of_depth(0.4 * frame()[0], CAMERA, frame()[1])
    size, _ = str(small.notes["doubt"]).split(" m is small for a person")
    assert float(size) == pytest.approx(small.notes["size"], 0.02)
    assert "person" not in str(form.notes.get("doubt"))
    assert (
        "doubt"
        not in canonical_form_of_depth(0.4 * frame()[0], CAMERA, frame()[1], "identity").notes
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
    depths, mask = frame()
    with pytest.raises((ConfigurationError, DepthError), match=message):
        canonical_form_of_depth(depths, camera, mask, method)


def test_a_larger_frame_holds_larger_objects():
    depths, mask = frame()
    grown = canonical_form_of_depth(1.6 * depths, CAMERA, mask, "identity", half_width=2.0)
    assert grown.notes["size"] > 2.57


def test_the_former_place_of_the_function_works_and_says_what_to_write_instead():
    with pytest.warns(DeprecationWarning, match="write 'from benchmark import canonical_form"):
        from benchmark.depth_forms import canonical_form_of_depth as former
    assert former is canonical_form_of_depth
    with pytest.raises(ImportError, match="cannot import name 'nothing'"):
        from benchmark.depth_forms import nothing  # noqa: F401

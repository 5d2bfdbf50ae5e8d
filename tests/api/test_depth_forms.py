"""Depth images in, canonical forms out, from Python."""

import numpy as np
import pytest

from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth_forms import canonical_form_of_depth, method_of_depth
from benchmark.errors import ConfigurationError, DepthError
from tests.depth.scenes import frame, in_millimetres

CAMERA = np.array([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]])


def test_arrays_come_in_and_a_form_goes_out():
    depths, mask = frame()
    form = canonical_form_of_depth(depths, CAMERA, mask)
    assert form.mesh.area == pytest.approx(1)
    assert form.notes["mask"] == "given"
    assert form.notes["up"] == "floor"
    assert form.notes["predicted_pieces"] == 1
    found = canonical_form_of_depth(depths, CAMERA)
    assert found.notes["mask"] == "found"


@pytest.mark.parametrize(
    "camera", [(525, 525, 319.5, 239.5), np.pad(CAMERA, (0, 1)), Intrinsics(525, 525, 319.5, 239.5)], ids=str
)
def test_every_way_to_pass_a_camera_and_depths_gives_the_same(camera):
    depths, mask = frame()
    millimetres = in_millimetres(depths)
    wanted = canonical_form_of_depth(millimetres, CAMERA, mask, "identity")
    for form in (
        canonical_form_of_depth(millimetres, camera, mask, "identity"),
        canonical_form_of_depth(millimetres / 1000, camera, 255 * mask.astype(np.uint8), "identity"),
        canonical_form_of_depth(5 * millimetres.astype(np.int32), camera, mask, "identity", scale=5000),
    ):
        np.testing.assert_array_equal(form.vertices, wanted.vertices)


def test_a_loop_loads_its_method_once():
    assert method_of_depth("learned-streamed") is method_of_depth("learned-streamed")


def test_errors_have_types():
    depths, mask = frame()
    with pytest.raises(DepthError):
        canonical_form_of_depth(np.full((480, 640), np.nan), CAMERA, mask)
    with pytest.raises(DepthError, match=r"are 6 numbers"):
        canonical_form_of_depth(depths, CAMERA[:2], mask)
    with pytest.raises(DepthError):
        canonical_form_of_depth(depths, CAMERA, ~mask[:10])
    with pytest.raises(DepthError, match="more than the 2.57 m of the frame"):
        canonical_form_of_depth(depths, CAMERA, np.ones_like(mask))
    with pytest.raises(ConfigurationError, match="unknown method"):
        canonical_form_of_depth(depths, CAMERA, mask, "learnt")
    with pytest.raises(ConfigurationError, match="describes shapes without a canonical form"):
        canonical_form_of_depth(depths, CAMERA, mask, "shape-dna")


def test_a_larger_frame_holds_larger_objects():
    depths, mask = frame()
    grown = canonical_form_of_depth(1.6 * depths, CAMERA, mask, "identity", half_width=2.0)
    assert grown.notes["size"] > 2.57

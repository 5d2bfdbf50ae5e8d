"""From depths to the object, upright, in metres."""

import numpy as np
import pytest
import trimesh

from benchmark.depth.errors import InvalidDepth, InvalidIntrinsics, InvalidMask, NoObject
from benchmark.depth.frame import UPRIGHT, observe, unprojected, without_flying_pixels
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.segmentation import background_planes
from benchmark.geometry.depth import render_depth
from benchmark.geometry.mesh import Mesh
from tests.depth.scenes import KINECT, DepthFaults, Pose, Scene, figure, frame, overlap, scene

TALL = np.ptp(figure().vertices[:, 2])


@pytest.mark.parametrize("given", [{"roll": 9.0}, {"distance": 3.5, "height": 1.7}, {"wall": None}], ids=str)
def test_the_rule_finds_the_figure(given):
    depths, mask = frame(**given)
    observed = observe(depths, KINECT)
    assert overlap(observed.mask, mask) > 0.93
    assert observed.notes["mask"] == "found"
    assert observed.notes["planes"] == (2 if given.get("wall", 1) else 1)
    assert observed.notes["up"] == "floor"


def test_the_nearest_of_the_large_pieces_is_the_object():
    def box(x, y, width):
        made = trimesh.creation.box((width, 0.4, width))
        return Mesh(made.vertices - made.bounds[0] + [x, y, 0.0], made.faces.astype(np.int32))

    for others in ((box(-1.3, 0.5, 0.7),), (box(0.9, -0.8, 0.1),)):  # a chest behind, and a small thing in front
        depths, mask = scene(others=others).drawn(KINECT)
        assert overlap(observe(depths, KINECT).mask, mask & (depths > 0)) > 0.93


def test_walls_and_floors_are_planes_and_a_board_is_none():
    depths, mask = frame()
    points = unprojected(depths, KINECT.rays(640, 480))
    planes = background_planes(points, depths > 0)
    assert [plane.is_floor for plane in planes].count(True) == 1
    floor = next(plane for plane in planes if plane.is_floor)
    assert -floor.offset == pytest.approx(1.2, abs=0.02)  # the height of the camera
    board = np.where(mask, 0.0, depths)
    board[150:330, 240:400] = 1.5
    planes = background_planes(unprojected(board, KINECT.rays(640, 480)), board > 0)
    assert not any(abs(plane.offset + 1.5) < 0.05 for plane in planes), "what something lies behind bounds no scene"


@pytest.mark.parametrize(("roll", "height"), [(0.0, 0.8), (10.0, 1.8)])
def test_up_is_that_of_the_floor(roll, height):
    depths, mask = frame(roll=roll, height=height)
    surface = observe(depths, KINECT, mask).surface
    extents = np.ptp(surface.vertices, axis=0)
    assert extents[1] == pytest.approx(TALL, abs=0.08)  # feet vanish in the floor
    top, low = (surface.vertices[surface.vertices[:, 1].argsort()[place], 0].mean() for place in
                (slice(-50, None), slice(50)))  # fmt: skip
    assert abs(top - low) < 0.3


def test_without_a_floor_what_is_said_is_up_else_that_of_the_image():
    tilted = scene(roll=10.0, wall=None, floor=False)
    depths, mask = tilted.drawn(KINECT)
    up = tilted.pose.rotation @ [0, 0, 1.0]
    with_up = observe(depths, KINECT, mask, tuple(up))
    without_up = observe(depths, KINECT, mask)
    assert (with_up.notes["up"], without_up.notes["up"]) == ("sidecar", "image")
    assert np.ptp(with_up.surface.vertices[:, 1]) == pytest.approx(TALL, abs=0.03)
    with pytest.raises(InvalidDepth, match="is up in no image; write .right, down, forward."):
        observe(depths, KINECT, mask, (0, 0, 1))


def test_the_surface_of_a_frame_without_faults_lies_on_the_body():
    """From afar through a long lens, the frame is the orthographic view of the body itself."""
    far = Intrinsics(7000, 7000, 319.5, 239.5)
    pose = Pose((0, -50, 0.85), (0, 0, 0.85))
    depths, mask = Scene(figure(), pose, wall=None, floor=False).drawn(far)
    observed = observe(depths, far, mask)
    standing = Mesh(figure().vertices[:, [0, 2, 1]] * [1, 1, -1], figure().faces)
    true = render_depth(standing, UPRIGHT, 1.285)
    rendered = render_depth(observed.surface, UPRIGHT, 1.285)
    assert overlap(true > 0, rendered > 0) > 0.97  # pixels of 7 mm
    both = (true > 0) & (rendered > 0)
    apart = 2.57 * (true - rendered)[both]  # metres
    shift = np.median(apart)  # for the middle of what is seen lies before that of the body
    assert 0 < shift < 0.1
    assert np.median(np.abs(apart - shift)) < 0.005


def test_pixels_between_two_surfaces_go():
    depths = np.full((20, 20), 2.0)
    depths[:, 10:] = 1.0
    flying = depths.copy()
    flying[3:17:3, 10] = 1.5
    filtered = without_flying_pixels(flying, np.ones_like(depths, dtype=bool))
    np.testing.assert_array_equal(filtered, flying != 1.5)


def test_each_fault_of_a_scene_is_named():
    depths, mask = frame()
    empty = np.zeros_like(mask)
    with pytest.raises(InvalidMask, match="the mask is empty"):
        observe(depths, KINECT, empty)
    with pytest.raises(InvalidMask, match="the mask has 320 x 240 pixels, the image 640 x 480"):
        observe(depths, KINECT, mask[::2, ::2])
    with pytest.raises(InvalidMask, match="no pixel of the mask has a depth"):
        observe(np.where(mask, 0, depths), KINECT, mask)
    with pytest.raises(InvalidIntrinsics, match="those of 640 x 480 pixels, the image has 320 x 240"):
        observe(depths[::2, ::2], KINECT)
    with pytest.raises(NoObject, match="the object shows 25 pixels, fewer than 200"):
        few = empty.copy()
        rows, columns = np.argwhere(mask).mean(axis=0).astype(int)
        few[rows : rows + 5, columns : columns + 5] = True
        observe(np.where(mask, depths, depths), KINECT, few)
    with pytest.raises(
        NoObject, match=r"the object is .* m \(width, height, depth\), more than the 2.57 m of the frame"
    ):
        observe(5 * depths, KINECT, mask)
    bare, _ = Scene(figure(), Pose((0, -3, 1), (0, 0, 1)), wall=1.0).drawn(KINECT)
    wall = DepthFaults().perturbed(np.where(bare > 0, 0, bare) + 3.0, np.random.default_rng(0))
    with pytest.raises(NoObject, match=r"left of the scene.*; pass a mask of it with --mask"):
        observe(wall, KINECT)

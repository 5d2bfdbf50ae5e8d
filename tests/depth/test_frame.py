"""From depths to the object, upright, in metres."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from benchmark.depth.frame import UPRIGHT, observe, unprojected
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.neighbours import DIRECTIONS, neighbours, on_surface
from benchmark.depth.segmentation import background_planes
from benchmark.errors import DepthError
from benchmark.geometry.depth import render_depth
from benchmark.geometry.mesh import Mesh
from tests.depth.scenes import KINECT, Scene, figure, frame, measured, overlap

TALL = np.ptp(figure().vertices[:, 2])


@pytest.mark.parametrize(
    ("shape", "n_pairs"),
    [
        ((1, 5), [4, 0, 0, 0]),
        ((5, 1), [0, 4, 0, 0]),
        ((1, 1), [0, 0, 0, 0]),
        ((2, 2), [2, 2, 1, 1]),
    ],
)
def test_images_of_one_row_or_column_have_neighbours_along_it_alone(
    shape: tuple[int, int], n_pairs: list[int]
) -> None:
    seen = np.ones(shape, dtype=bool)
    pairs = [neighbours(seen, direction) for direction in DIRECTIONS]
    assert [len(first) for first, _ in pairs] == n_pairs
    assert [len(second) for _, second in pairs] == n_pairs


@pytest.mark.parametrize(
    "given", [{"roll": 9.0}, {"distance": 3.5, "height": 1.7}, {"wall": None}], ids=str
)
def test_the_rule_finds_the_figure(given: dict[str, float]) -> None:
    depths, mask = frame(**given)
    observed = observe(depths, KINECT)
    assert overlap(observed.mask, mask) > 0.93
    assert (observed.notes["mask"], observed.notes["up"]) == ("found", "floor")
    assert observed.notes["planes"] == (2 if given.get("wall", 1) else 1)


@pytest.mark.parametrize(
    "place", [(-1.3, 0.5, 0.7), (0.9, -0.8, 0.1)], ids=["chest behind", "small thing in front"]
)
def test_the_nearest_of_the_large_pieces_is_the_object(place: tuple[float, float, float]) -> None:
    x, y, width = place
    made = trimesh.creation.box((width, 0.4, width))
    box = Mesh(made.vertices - made.bounds[0] + [x, y, 0.0], made.faces)
    depths, mask = Scene((0.2, -2.5, 1.2), others=(box,)).drawn()
    assert overlap(observe(depths, KINECT).mask, mask & (depths > 0)) > 0.93


def test_a_board_before_a_wall_is_no_plane_of_the_background() -> None:
    depths, mask = frame()
    board = np.where(mask, 0.0, depths)
    board[150:330, 240:400] = 1.5
    planes = background_planes(unprojected(board, KINECT.rays(640, 480)), board > 0)
    assert not any(abs(plane.offset + 1.5) < 0.05 for plane in planes), (
        "what something lies behind bounds no scene"
    )


@pytest.mark.parametrize(("roll", "height"), [(0.0, 0.8), (10.0, 1.8)])
def test_up_is_that_of_the_floor(roll: float, height: float) -> None:
    depths, mask = frame(roll=roll, height=height)
    observed = observe(depths, KINECT, mask)
    notes = observed.notes
    assert 0 < notes["flying_pixels"] == (mask & (depths > 0)).sum() - notes["object_pixels"]
    assert notes["object_pixels"] + notes["filled_pixels"] == observed.mask.sum()
    surface = observed.surface.vertices
    assert np.ptp(surface[:, 1]) == pytest.approx(TALL, abs=0.08)  # feet vanish in the floor
    order = surface[:, 1].argsort()
    assert abs(surface[order[-50:], 0].mean() - surface[order[:50], 0].mean()) < 0.3


def test_without_a_floor_what_is_said_is_up_else_that_of_the_image() -> None:
    tilted = Scene((0.2, -2.5, 1.2), roll=10.0, wall=None, floor=False)
    depths, mask = tilted.drawn()
    with_up = observe(depths, KINECT, mask, tuple(tilted.rotation @ [0, 0, 1.0]))
    assert (with_up.notes["up"], observe(depths, KINECT, mask).notes["up"]) == ("sidecar", "image")
    assert np.ptp(with_up.surface.vertices[:, 1]) == pytest.approx(TALL, abs=0.03)
    with pytest.raises(
        DepthError, match="not a usable up direction: .*; write .right, down, forward."
    ):
        observe(depths, KINECT, mask, (0, 0, 1))


def test_the_surface_of_a_frame_without_faults_lies_on_the_body() -> None:
    """From afar through a long lens, the frame is the orthographic view of the body itself."""
    far = Intrinsics(7000, 7000, 319.5, 239.5)
    depths, mask = Scene((0, -50, 0.85), wall=None, floor=False).drawn(far)
    standing = Mesh(figure().vertices[:, [0, 2, 1]] * [1, 1, -1], figure().faces)
    surface = observe(depths, far, mask).surface
    assert surface.n_vertices < 1.2 * np.count_nonzero(mask)  # pixels side by side share corners
    true, found = (render_depth(mesh, UPRIGHT, 1.285) for mesh in (standing, surface))
    assert overlap(true > 0, found > 0) > 0.97  # pixels of 7 mm
    apart = 2.57 * (true - found)[(true > 0) & (found > 0)]  # metres
    shift = np.median(apart)  # for the middle of what is seen lies before that of the body
    assert 0 < shift < 0.1
    assert np.median(np.abs(apart - shift)) < 0.005


def test_pixels_between_two_surfaces_go() -> None:
    depths = np.full((20, 20), 2.0)
    depths[:, 10:] = 1.0
    depths[3:17:3, 10] = 1.5
    np.testing.assert_array_equal(on_surface(depths, depths > 0), depths != 1.5)


def test_each_fault_of_a_scene_is_named() -> None:
    depths, mask = frame()
    few = np.zeros_like(mask)
    rows, columns = np.argwhere(mask).mean(axis=0).astype(int)
    few[rows : rows + 5, columns : columns + 5] = True
    for image, given, reason in (
        (depths, mask & False, "the mask is empty"),
        (depths, mask[::2, ::2], "the mask has 320 x 240 pixels, the image 640 x 480"),
        (np.where(mask, 0, depths), mask, "no pixel of the mask has a depth"),
        (depths[::2, ::2], None, "those of 640 x 480 pixels, the image has 320 x 240"),
        (depths, few, "the object shows 2. pixels, fewer than 200"),
        (
            5 * depths,
            mask,
            r"the object is .* m \(width, height, depth\), more than the 2.57 m of the frame",
        ),
        (
            measured(np.full((480, 640), 3.0)),
            None,
            r"left of the scene.*; pass a mask of it with --mask",
        ),
    ):
        with pytest.raises(DepthError, match=reason) as caught:
            observe(image, KINECT, given)
        assert caught.value.hint

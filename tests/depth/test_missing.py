"""The absence of a reading is no edge of a body, only a jump of depth is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmark.depth import reading
from benchmark.depth.filling import in_gaps_of_mask
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, FrameFiles, ObservedObject, observe
from benchmark.depth.intrinsics import Intrinsics, read_intrinsics
from benchmark.depth.neighbours import NEIGHBOUR_GAP
from benchmark.depth.reading import Depths, Mask
from benchmark.errors import DepthError
from benchmark.geometry.depth import View, depth_surface
from tests.fuzz_frames import fuzz

INPUTS = Path(__file__).with_name("inputs") / "missing"
#: Rows and columns of the part of a frame of 320 x 240 pixels that shows the object: the rest costs
#: time alone.
ROWS, COLUMNS = np.mgrid[20:220, 80:240]
SHAPE = ROWS.shape
CAMERA = Intrinsics(260.0, 260.0, 79.5, 99.5, (SHAPE[1], SHAPE[0]))

#: Rows of the bars of :func:`legs`.
HEIGHT_OF_LEGS = (ROWS >= 40) & (ROWS < 200)

Damage = Callable[[Depths, Mask], tuple[Depths, Mask]]


def ellipsoid(centre: tuple[float, float, float], axes: tuple[float, float, float]) -> Depths:
    """Return the depths of an ellipsoid in a camera's axes, in metres; infinity beside it."""
    rays = np.concatenate([CAMERA.rays(SHAPE[1], SHAPE[0]), np.ones((*SHAPE, 1))], axis=-1)
    directions, middle = rays / axes, np.array(centre) / axes
    a = (directions**2).sum(axis=-1)
    b = directions @ middle
    c = middle @ middle - 1
    root = np.sqrt(np.maximum(b * b - a * c, 0))
    return np.where(b * b > a * c, (b - root) / a, np.inf)


def before_a_wall(*bodies: Depths) -> tuple[Depths, Mask]:
    """Return a frame with bodies before a wall, and their pixels."""
    depths = np.min([np.full(SHAPE, 3.5), *bodies], axis=0)
    return depths, depths < 3.5


BODY, OBJECT = before_a_wall(ellipsoid((0, 0, 2), (0.3, 0.6, 0.2)))


def view(observed: ObservedObject) -> View:
    return depth_surface(observed.surface, UPRIGHT, HALF_WIDTH)


AREA = view(observe(BODY, CAMERA, OBJECT)).surface.area


def without(lost: Mask) -> Damage:
    return lambda depths, mask: (np.where(lost, 0, depths), mask)


def without_in_both(lost: Mask) -> Damage:
    return lambda depths, mask: (np.where(lost, 0, depths), mask & ~lost)


def without_in_mask(lost: Mask) -> Damage:
    return lambda depths, mask: (depths, mask & ~lost)


RANDOM = np.random.default_rng(0).random(BODY.shape)
DAMAGES: dict[str, Damage] = {
    "a column": without(COLUMNS == 160),
    "a row": without(ROWS == 120),
    "two columns": without(COLUMNS // 2 == 80),
    "six rows": without(ROWS // 6 == 20),
    "every twentieth column": without(COLUMNS % 20 == 0),
    "a diagonal": without(COLUMNS - ROWS == 40),
    "two diagonals": without((COLUMNS - ROWS) // 2 == 20),
    "30 % at random": without(RANDOM < 0.3),
    "every other column": without(COLUMNS % 2 == 1),
    "a dark place": without(np.hypot(COLUMNS - 160, ROWS - 120) < 6),
    "a column, also of the mask": without_in_both(COLUMNS == 160),
    "two rows, also of the mask": without_in_both(ROWS // 2 == 60),
    "30 % at random, also of the mask": without_in_both(RANDOM < 0.3),
    "a column of the mask": without_in_mask(COLUMNS == 160),
    "two rows of the mask": without_in_mask(ROWS // 2 == 60),
    "a diagonal of the mask": without_in_mask(COLUMNS - ROWS == 40),
    "a tenth of the mask": without_in_mask(RANDOM < 0.1),
}


@pytest.mark.parametrize("name", DAMAGES)
@pytest.mark.parametrize("has_background", [True, False])
def test_a_pixel_without_a_reading_is_no_edge(name: str, has_background: bool) -> None:
    """The area of the whole surface is found in one piece, within that of pixels at its edge."""
    depths, mask = DAMAGES[name](BODY if has_background else np.where(OBJECT, BODY, 0), OBJECT)
    observed = observe(depths, CAMERA, mask)
    seen = view(observed)
    assert seen.report["pieces"] == 1
    assert seen.surface.area == pytest.approx(AREA, rel=0.07)
    assert observed.notes["distance"] == pytest.approx(1.849, abs=0.005)
    filled = observed.mask & (depths == 0)
    assert observed.notes["filled_pixels"] == np.count_nonzero(filled)
    np.testing.assert_allclose(observed.depths[filled], BODY[filled], atol=0.02)
    measured = ~filled
    np.testing.assert_array_equal(observed.depths[measured], depths[measured])


@pytest.mark.parametrize("name", [name for name in DAMAGES if "mask" not in name])
def test_a_line_without_readings_does_not_halve_the_object_that_is_found(name: str) -> None:
    seen = view(observe(DAMAGES[name](BODY, OBJECT)[0], CAMERA))
    assert seen.report["pieces"] == 1
    assert seen.surface.area == pytest.approx(AREA, rel=0.07)


def between_legs(gap: int) -> Mask:
    """Return the pixels between two upright bars that are a gap apart."""
    return HEIGHT_OF_LEGS & (COLUMNS >= 160) & (160 + gap > COLUMNS)


def legs(gap: int, behind: float) -> tuple[Depths, Mask]:
    """Return two upright bars 2 m away, the pixels between them at another depth, and the pixels of
    both bars.
    """
    is_left = (COLUMNS >= 130) & (COLUMNS < 160)
    is_right = (160 + gap <= COLUMNS) & (190 + gap > COLUMNS)
    mask = HEIGHT_OF_LEGS & (is_left | is_right)
    depths = np.where(between_legs(gap), behind, 3.5)
    return np.where(mask, 2.0, depths), mask


@pytest.mark.parametrize("gap", [1, 2, 5])
@pytest.mark.parametrize("behind", [2.2, 3.5])
@pytest.mark.parametrize("lost", [0.0, 0.1, 0.3])
def test_two_legs_with_background_between_them_stay_apart(
    gap: int, behind: float, lost: float
) -> None:
    depths, mask = legs(gap, behind)
    depths = np.where(lost > RANDOM, 0, depths)
    for given in (mask, mask & (depths > 0)):
        observed = observe(depths, CAMERA, given)
        assert not observed.mask[between_legs(gap)].any()
        assert view(observed).report["pieces"] == 2


@pytest.mark.parametrize("every", [3, 7, 15])
@pytest.mark.parametrize("gap", [1, 2])
def test_two_legs_stay_apart_where_few_pixels_between_them_have_a_reading(
    every: int, gap: int
) -> None:
    depths, mask = legs(gap, 3.5)
    between = between_legs(gap)
    observed = observe(np.where(between & (ROWS % every > 0), 0, depths), CAMERA, mask)
    assert not (observed.mask & between).any()
    assert view(observed).report["pieces"] == 2


def test_a_dead_line_does_not_join_legs() -> None:
    depths, mask = legs(1, 3.5)
    depths[ROWS == 120] = 0
    observed = observe(depths, CAMERA, mask)
    assert observed.mask[mask & (ROWS == 120)].all()
    assert not observed.mask[COLUMNS == 160].any()


def test_a_jump_of_depth_is_an_edge_whether_or_not_pixels_are_missing_there() -> None:
    depths = np.where(COLUMNS < 160, 2.0, 2.3)
    missing = (COLUMNS >= 158) & (COLUMNS < 162)
    depths[missing] = 0
    mask = (ROWS >= 60) & (ROWS < 180) & (COLUMNS >= 100) & (COLUMNS < 220)
    observed = observe(depths, CAMERA, mask)
    assert not observed.mask[missing].any()
    assert view(observed).report["pieces"] == 2


def test_a_mask_that_is_a_box_does_not_join_limbs_before_a_background_that_was_cut_away() -> None:
    depths, mask = legs(8, 0.0)
    depths = np.where(mask, depths, 0)
    box = (ROWS >= 30) & (ROWS < 210) & (COLUMNS >= 90) & (COLUMNS < 230)
    assert not observe(depths, CAMERA, box).mask[between_legs(8)].any()


def test_a_gap_of_zeros_in_a_mask_that_fits_belongs_to_the_object() -> None:
    depths, mask = legs(8, 0.0)
    between = between_legs(8)
    assert observe(depths, CAMERA, mask | between).mask[between & (ROWS == 100)].all()
    assert not observe(depths, CAMERA, mask).mask[between].any()


@pytest.mark.parametrize(
    ("name", "distance", "size"),
    [
        ("control.png", 1.849, 1.181),
        ("dead-column.png", 1.849, 1.181),
        ("kinect-registered.png", 1.849, 1.181),
        ("sparse.png", 1.849, 1.17),
        ("area-5-percent.npz", 1.849, 1.177),
    ],
)
def test_frames_of_an_ellipsoid_with_missing_pixels(
    name: str, distance: float, size: float
) -> None:
    observed = FrameFiles(INPUTS / name).observe()
    assert observed.notes["distance"] == pytest.approx(distance, abs=0.003)
    assert observed.notes["size"] == pytest.approx(size, abs=0.012)
    assert np.ptp(observed.surface.vertices[:, 2]) == pytest.approx(0.175, abs=0.02)
    seen = view(observed)
    assert seen.report["pieces"] == 1
    assert seen.surface.area == pytest.approx(AREA, rel=0.1)


def test_an_image_that_averages_most_depths_with_missing_pixels_is_refused() -> None:
    with pytest.raises(DepthError, match="depth jumps between most of .*; resize depth images by"):
        FrameFiles(INPUTS / "area-30-percent.npz").observe()


def test_a_frame_that_shows_its_object_well_has_no_doubts() -> None:
    assert not observe(BODY, CAMERA, OBJECT).doubts
    assert not observe(DAMAGES["30 % at random"](BODY, OBJECT)[0], CAMERA, OBJECT).doubts


@pytest.mark.parametrize("is_found", [True, False])
def test_an_image_that_was_averaged_says_so(is_found: bool) -> None:
    """Its edges were averaged, too, which no reading tells."""
    frame = FrameFiles(INPUTS / "area-5-percent.npz")
    depths, intrinsics = reading.read_values(frame.image), read_intrinsics(INPUTS / "camera.json")
    mask = None if is_found else reading.read_mask(frame.mask_file)
    whats = [what for what, _ in observe(depths, intrinsics, mask).doubts]
    assert any("were averaged with missing ones" in what for what in whats)


@pytest.mark.parametrize(("axes", "is_sure"), [((0.25, 0.3, 0.1), True), ((0.2, 0.25, 0.1), False)])
def test_a_frame_of_few_pixels_says_that_its_form_depends_on_them(
    axes: tuple[float, float, float], is_sure: bool
) -> None:
    depths, mask = before_a_wall(ellipsoid((0, 0, 2), axes))
    observed = observe(depths, CAMERA, mask)
    assert is_sure == (observed.notes["object_pixels"] >= 3000)
    assert is_sure == (not observed.doubts)


@pytest.mark.parametrize("every", [4, 5, 7])
def test_depths_without_neighbours_are_named(every: int) -> None:
    sparse = np.where((ROWS % every == 0) & (COLUMNS % every == 0), BODY, 0)
    with pytest.raises(DepthError, match="no neighbour with a depth; if the image was registered"):
        observe(sparse, CAMERA, OBJECT)


def test_frames_of_known_geometry_have_its_figures_or_are_refused() -> None:
    assert not fuzz(2, range(45))["wrong"]


@pytest.mark.parametrize(("width", "is_found"), [(NEIGHBOUR_GAP, True), (NEIGHBOUR_GAP + 1, False)])
def test_readings_in_a_gap_of_a_mask_are_taken_up_to_the_widest_gap(width, is_found):
    depths = np.full((1, 20), 2.0)
    kept = np.ones((1, 20), dtype=bool)
    kept[:, 8 : 8 + width] = False
    found = in_gaps_of_mask(depths, kept)
    assert found.sum() == (width if is_found else 0)

"""SIFT without its background, and without keypoints, and beside OpenCV."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from retrieval.features import EDGE_RATIO, _detect_all, detect_views, mirrored
from retrieval.scale_space import BASE_SCALE

pytestmark = pytest.mark.kernels


def test_the_mirror_image_of_a_view_has_mirrored_descriptors():
    rng = np.random.default_rng(1)
    image = gaussian_filter(rng.uniform(size=(2, 129, 129)), (0, 3, 3)).astype(np.float32)
    features, flipped = (
        detect_views(np.ascontiguousarray(one), peak_threshold=1e-3, background=np.nan)
        for one in (
            image,
            image[::-1, ::-1],
        )  # the two views change places, and each is turned upside down
    )
    found = mirrored(features, np.array([1, 0], dtype=np.int32))
    np.testing.assert_allclose(found["view_offsets"], flipped["view_offsets"], atol=3)
    near = (
        np.abs(found["descriptors"][:, None].astype(int) - flipped["descriptors"])
        .max(axis=2)
        .min(axis=1)
    )
    assert (near <= 4).mean() > 0.9


@pytest.fixture(scope="module")
def spots():
    """An image of spots in bytes, and the frames and descriptors of its keypoints."""
    image = gaussian_filter(np.random.default_rng(0).uniform(size=(256, 256)), 2)
    image = np.uint8(255 * (image - image.min()) / np.ptp(image))
    return image, *_detect_all(np.float32(image / 255)[None], np.float32(np.nan), 1e-3, EDGE_RATIO)[
        :2
    ]


def test_descriptors_are_those_of_opencv_at_the_same_keypoints(spots):
    image, frames, descriptors = spots
    steps = 3 * np.log2(frames[:, 2] / BASE_SCALE)
    octaves = np.maximum((steps - 0.5) // 3, 0).astype(int)
    layers = np.clip(np.rint(steps - 3 * octaves), 1, 3).astype(int)
    keypoints = [
        cv2.KeyPoint(x, y, 2 * scale, np.degrees(angle), 1, int(octave | layer << 8))
        for (x, y, scale, angle), octave, layer in zip(frames, octaves, layers, strict=True)
    ]
    _, theirs = cv2.SIFT_create().compute(image, keypoints)
    ours = descriptors.reshape(-1, 16, 8)[:, :, -np.arange(8) % 8].reshape(
        theirs.shape
    )  # it turns the other way round
    ours, theirs = (
        each / np.linalg.norm(each.astype(float), axis=1)[:, None] for each in (ours, theirs)
    )
    assert len(ours) > 500
    assert np.median((ours * theirs).sum(axis=1)) > 0.996


def test_orientations_are_those_of_opencv_where_both_find_a_keypoint(spots):
    image, frames, _ = spots
    found = cv2.SIFT_create(contrastThreshold=0.003).detect(image)
    theirs = np.array([(*point.pt, point.size / 2, np.radians(point.angle)) for point in found])
    theirs[:, :2] -= 0.25  # its image of twice the size is not centred
    tree, apart = cKDTree(frames[:, :2]), []
    for x, y, scale, angle in theirs:
        near = frames[tree.query_ball_point((x, y), 0.2 * scale)]
        near = near[np.abs(near[:, 2] / scale - 1) < 0.05]
        turns = np.degrees((near[:, 3] - angle + np.pi) % (2 * np.pi) - np.pi)
        apart += turns[np.abs(turns).argsort()[:1]].tolist()
    assert len(apart) > 500
    assert abs(np.median(apart)) < 0.5
    assert np.median(np.abs(apart)) < 2.5
    assert np.mean(np.abs(apart) < 15) > 0.85

"""SIFT without its background, without keypoints, and on images that are no depths."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmark.errors import InvalidMesh
from retrieval.features import detect_views

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize("peak_threshold", [1e-3, 0.0])
def test_leaving_out_the_background_changes_nothing(peak_threshold):
    rng = np.random.default_rng(5)
    image = np.ones((1, 256, 256), np.float32)
    image[0, 70:171, 93:150] = 0.3 + 0.4 * gaussian_filter(rng.uniform(size=(101, 57)), 3)
    cropped, whole = (
        detect_views(image, peak_threshold=peak_threshold, background=background).descriptors
        for background in (1.0, np.nan)
    )
    assert len(cropped) == len(whole) > 20
    assert np.abs(cropped.astype(int) - whole).max() <= 1


def test_images_without_keypoints_are_fine():
    images = np.ones((3, 64, 64), np.float32)
    images[2, 20:40, 25:35] = 0.5
    features = detect_views(images, peak_threshold=0.0, background=1.0)
    assert features.view_offsets[:3].tolist() == [0, 0, 0]
    assert features.view_offsets[3] == len(features.descriptors) > 0
    small = detect_views(np.zeros((1, 8, 8), np.float32), peak_threshold=0.0, background=1.0)
    assert small.descriptors.shape == (0, 128)


def test_the_mirror_image_of_a_view_has_mirrored_descriptors():
    rng = np.random.default_rng(1)
    image = gaussian_filter(rng.uniform(size=(2, 129, 129)), (0, 3, 3)).astype(np.float32)
    features, flipped = (
        detect_views(np.ascontiguousarray(one), peak_threshold=1e-3, background=np.nan)
        for one in (image, image[::-1, ::-1])  # the two views change places, and each is turned upside down
    )
    mirrored = features.mirrored(np.array([1, 0], dtype=np.int32))
    np.testing.assert_allclose(mirrored.view_offsets, flipped.view_offsets, atol=3)
    near = np.abs(mirrored.descriptors[:, None].astype(int) - flipped.descriptors).max(axis=2).min(axis=1)
    assert (near <= 4).mean() > 0.9


@pytest.mark.parametrize("value", [np.nan, -np.inf, 3e38, -3e38])
def test_images_that_are_no_depths_are_refused(value):
    image = np.zeros((1, 32, 32), dtype=np.float32)
    image[0, 5, 7] = value
    with pytest.raises(InvalidMesh, match="NaN"):
        detect_views(image, peak_threshold=1e-3, background=1.0)

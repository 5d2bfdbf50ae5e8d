from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from benchmark.errors import InvalidMesh
from retrieval.features import EDGE_RATIO, _checked, _detect_all, detect_views

pytestmark = pytest.mark.kernels

PEAK = 0.04 / 3  # OpenCV divides its contrast threshold by the levels per octave.


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one image: positions (x, y), scales, angles and descriptors."""

    positions: NDArray[np.float64]
    scales: NDArray[np.float64]
    angles: NDArray[np.float64]
    descriptors: NDArray[np.uint8]


def detect(image: ArrayLike, *, peak_threshold: float, background: float = np.nan) -> Keypoints:
    stack = _checked(np.asarray(image, dtype=np.float32)[None])
    frames, descriptors, _ = _detect_all(stack, np.float32(background), peak_threshold, EDGE_RATIO)
    return Keypoints(frames[:, :2], frames[:, 2], frames[:, 3], descriptors)


@pytest.fixture(scope="module")
def photograph() -> NDArray[Any]:
    from sklearn.datasets import load_sample_image

    return load_sample_image("china.jpg")[80:380, 100:500].mean(axis=2).astype(np.uint8)


def find(image: NDArray[Any]) -> Keypoints:
    return detect(image.astype(np.float32) / 255, peak_threshold=PEAK)


def matched(expected: Keypoints, detected: Keypoints, inside: NDArray[Any]) -> tuple[float, float]:
    """Share of expected keypoints that are found, and the median cosine of their descriptors."""
    hits, cosines = 0, []
    for k in np.flatnonzero(inside):
        position, scale, angle = expected.positions[k], expected.scales[k], expected.angles[k]
        descriptor = expected.descriptors[k]
        near = np.linalg.norm(detected.positions - position, axis=1) < 0.5 * scale
        near &= np.abs(np.log2(detected.scales / scale)) < 0.25
        near &= np.abs((detected.angles - angle + np.pi) % (2 * np.pi) - np.pi) < 0.3
        if near.any():
            hits += 1
            others = detected.descriptors[near].astype(float)
            norms = np.linalg.norm(others, axis=1) * np.linalg.norm(descriptor.astype(float))
            cosines.append((others @ descriptor / norms).max())
    return hits / max(inside.sum(), 1), float(np.median(cosines))


def test_agrees_with_opencv(photograph: NDArray[Any]) -> None:
    cv2 = pytest.importorskip("cv2")
    points, descriptors = cv2.SIFT.create().detectAndCompute(photograph, None)
    # OpenCV counts gradient angles the other way round.
    flipped = descriptors.reshape(-1, 4, 4, 8)[..., (-np.arange(8)) % 8].reshape(-1, 128)
    theirs = Keypoints(
        np.array([p.pt for p in points]),
        np.array([p.size / 2 for p in points]),
        np.deg2rad([p.angle for p in points]),
        flipped.astype(np.uint8),
    )
    # OpenCV doubles the image: smaller keypoints than these exist only there.
    rate, cosine = matched(theirs, find(photograph), theirs.scales > 2.4)
    assert rate > 0.8
    assert cosine > 0.99


@pytest.mark.parametrize("peak_threshold", [1e-3, 0.0])
def test_leaving_out_the_background_changes_nothing(peak_threshold: float) -> None:
    rng = np.random.default_rng(5)
    image = np.ones((256, 256), np.float32)
    image[70:171, 93:150] = 0.3 + 0.4 * gaussian_filter(rng.uniform(size=(101, 57)), 3)
    cropped = detect(image, peak_threshold=peak_threshold, background=1.0)
    whole = detect(image, peak_threshold=peak_threshold)
    assert len(cropped.scales) == len(whole.scales) > 20
    np.testing.assert_allclose(cropped.positions, whole.positions, rtol=1e-12)
    np.testing.assert_allclose(cropped.scales, whole.scales, rtol=1e-12)
    assert np.abs(cropped.descriptors.astype(int) - whole.descriptors).max() <= 1


def test_images_without_keypoints_are_fine() -> None:
    images = np.ones((3, 64, 64), np.float32)
    images[2, 20:40, 25:35] = 0.5
    features = detect_views(images, peak_threshold=1e-3, background=1.0)
    assert features.view_offsets[:3].tolist() == [0, 0, 0]
    assert features.view_offsets[3] == len(features.descriptors) > 0
    assert detect(np.zeros((8, 8)), peak_threshold=1e-3).descriptors.shape == (0, 128)


@pytest.mark.parametrize("value", [np.nan, -np.inf, 3e38, -3e38])
def test_images_that_are_no_depths_are_refused(value: float) -> None:
    image = np.zeros((32, 32), dtype=np.float32)
    image[5, 7] = value
    with pytest.raises(InvalidMesh, match="NaN"):
        detect(image, peak_threshold=1e-3)

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from benchmark.errors import InvalidMesh
from retrieval.features import EDGE_RATIO, _checked, _detect_all, detect_views
from retrieval.gaussian_blur import blur, gaussian_kernel

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


def matched(expected: Keypoints, found: Keypoints, inside: NDArray[Any]) -> tuple[float, float]:
    """Share of expected keypoints that are found, and the median cosine of their descriptors."""
    hits, cosines = 0, []
    for k in np.flatnonzero(inside):
        position, scale, angle = expected.positions[k], expected.scales[k], expected.angles[k]
        descriptor = expected.descriptors[k]
        near = np.linalg.norm(found.positions - position, axis=1) < 0.5 * scale
        near &= np.abs(np.log2(found.scales / scale)) < 0.25
        near &= np.abs((found.angles - angle + np.pi) % (2 * np.pi) - np.pi) < 0.3
        if near.any():
            hits += 1
            others = found.descriptors[near].astype(float)
            norms = np.linalg.norm(others, axis=1) * np.linalg.norm(descriptor.astype(float))
            cosines.append((others @ descriptor / norms).max())
    return hits / max(inside.sum(), 1), float(np.median(cosines))


@pytest.mark.parametrize("shape", [(40, 33), (4, 8), (1, 1)])
def test_blur_agrees_with_scipy(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).uniform(size=shape).astype(np.float32)
    result = np.empty_like(image)
    blur(image, result, gaussian_kernel(1.7))
    np.testing.assert_allclose(result, gaussian_filter(image, 1.7, mode="nearest", truncate=4.2), atol=2e-6)


def test_blur_rounds_every_product_and_sum_in_the_order_of_the_weights() -> None:
    image = np.random.default_rng(0).uniform(size=(37, 45)).astype(np.float32)
    kernel, result = gaussian_kernel(1.7), np.empty_like(image)
    blur(image, result, kernel)
    expected = image
    for _ in range(2):
        padded = np.pad(expected, ((len(kernel) - 1,) * 2, (0, 0)), mode="edge")
        total = kernel[0] * expected
        for j in range(1, len(kernel)):
            above, below = (padded[len(kernel) - 1 + step :][: len(expected)] for step in (-j, j))
            total += kernel[j] * (above + below)
        expected = total.T
    np.testing.assert_array_equal(result, expected)


def test_a_gaussian_blob_is_one_keypoint_of_its_own_scale(sigma: float = 5.0) -> None:
    rows, columns = np.mgrid[:128, :128]
    blob = 1 - np.exp(-((columns - 70.3) ** 2 + (rows - 58.8) ** 2) / (2 * sigma**2)).astype(np.float32)
    found = detect(blob, peak_threshold=0.02)
    strongest = np.unique(np.round(found.positions, 1), axis=0)
    assert len(strongest) == 1
    np.testing.assert_allclose(strongest[0], [70.3, 58.8], atol=0.1)
    # Of G(k s) - G(s) over a blob of width b the extremum lies where s^2 = (b^2 - nominal blur^2) / k, k = 2^(1/3).
    assert found.scales[0] == pytest.approx(np.sqrt((sigma**2 - 0.25) / 2 ** (1 / 3)), rel=0.02)


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


@pytest.mark.parametrize(("degrees", "zoom", "least"), [(135, 1, 0.8), (30, 1.3, 0.8)])
def test_keypoints_follow_rotation_and_scale(
    photograph: NDArray[Any], degrees: float, zoom: float, least: float
) -> None:
    cv2 = pytest.importorskip("cv2")
    height, width = photograph.shape
    motion = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, zoom)
    moved = cv2.warpAffine(photograph, motion, (width, height), flags=cv2.INTER_CUBIC)
    original = find(photograph)
    expected = Keypoints(
        original.positions @ motion[:, :2].T + motion[:, 2],
        original.scales * zoom,
        original.angles - np.deg2rad(degrees),
        original.descriptors,
    )
    x, y = expected.positions.T
    inside = (x > 20) & (y > 20) & (x < width - 20) & (y < height - 20) & (expected.scales > 2.4)
    rate, cosine = matched(expected, find(moved), inside)
    assert rate > least
    assert cosine > 0.99


def test_a_mirrored_image_has_the_mirrored_features(photograph: NDArray[Any]) -> None:
    # An odd width keeps the sampling of the octaves symmetric under reflection.
    image = photograph[:257, :257].astype(np.float32) / 255
    original = detect_views(image[None], peak_threshold=PEAK, background=np.nan)
    mirrored = detect_views(image[None, :, ::-1].copy(), peak_threshold=PEAK, background=np.nan)
    flipped = original.mirrored(np.array([0], dtype=np.int32))

    def nearest(descriptors: NDArray[Any]) -> NDArray[Any]:
        differences = descriptors[:, None].astype(float) - mirrored.descriptors[None]
        return np.linalg.norm(differences, axis=2).min(axis=1)

    assert np.quantile(nearest(flipped.descriptors), 0.8) < 20
    assert np.median(nearest(original.descriptors)) > 150


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

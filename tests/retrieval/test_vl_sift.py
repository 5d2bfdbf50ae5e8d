"""Keypoints beside those of vl_sift, which the original uses [Vedaldi & Fulkerson 2008]."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from retrieval.features import EDGE_RATIO, _detect_all
from retrieval.pose import to_unit_sphere
from retrieval.views import BACKGROUND, render, view_sphere
from tests.golden import inputs
from tests.retrieval.figures import figure

#: Position and scale of each keypoint of vl_sift of VLFeat 0.9.21 under Octave, counted from 0,
#: without repetitions, by name of the image and place of the threshold.
GOLDEN = Path(__file__).with_name("vl_sift.npz")
THRESHOLDS = (1e-3, 0.0)


@cache
def images() -> Mapping[str, tuple[NDArray[np.float32], float]]:
    """Ten images by name, with their backgrounds."""
    meshes = {
        "figure": figure(),
        **{name: inputs.mesh("shapes", name) for name in ("closed", "bridged", "large", "open")},
    }
    drawn = {
        name: render(to_unit_sphere(mesh), 256, view_sphere(2))[7] for name, mesh in meshes.items()
    }
    depths = {**inputs.arrays("depth"), "frame": inputs.arrays("frame")["depth"]}
    uniform = np.random.RandomState(0).uniform  # a frozen stream
    noise = {"noise_square": uniform(size=(400, 400)), "noise_wide": uniform(size=(300, 517))}
    return {
        **{f"form_{name}": (image, BACKGROUND) for name, image in drawn.items()},
        **{f"depth_{name}": (np.float32(image / 4096), 0.0) for name, image in depths.items()},
        **{name: (np.float32(image), np.nan) for name, image in noise.items()},
    }


def n_same(first: NDArray[Any], second: NDArray[Any]) -> int:
    """Number of keypoints that are among others: within .05 of their scale, which is the same to 2
    %.
    """
    places = cKDTree(second[:, :2]).query_ball_point(first[:, :2], 0.05 * first[:, 2])
    ratios = [second[near, 2] / scale for near, scale in zip(places, first[:, 2], strict=True)]
    return sum(bool((np.abs(ratio - 1) < 0.02).any()) for ratio in ratios)


@pytest.mark.parametrize("kind", ["form", "depth", "noise"])
@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_keypoints_are_those_of_vl_sift(threshold: float, kind: str) -> None:
    n_ours = n_theirs = same = 0
    with np.load(GOLDEN, allow_pickle=False) as theirs:
        for name, (image, background) in images().items():
            if name.startswith(kind):
                frames = _detect_all(image[None], np.float32(background), threshold, EDGE_RATIO)[0]
                ours, expected = (
                    np.unique(frames[:, :3], axis=0),
                    theirs[f"{name}_{THRESHOLDS.index(threshold)}"],
                )
                n_ours, n_theirs, same = (
                    n_ours + len(ours),
                    n_theirs + len(expected),
                    same + n_same(expected, ours),
                )
    assert n_theirs > 90
    assert n_ours == pytest.approx(n_theirs, rel=0.01)
    assert same >= 0.99 * n_theirs

"""Time to turn one form into its signature, against ray casting followed by OpenCV's SIFT.

Ours runs on one core: pose normalisation, 66 depth images, SIFT, and the nearest words. The peer gets the normalised
form and two processes: trimesh with Embree casts the same rays, OpenCV describes the eight-bit images at its defaults;
its words are not looked up.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from benchmark.geometry.mesh import Mesh
from retrieval.cmbof import CMBOF
from retrieval.features import detect_views
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, CAMERAS, N_VIEWS, render
from tests.retrieval.figures import figure

PEER_PROCESSES = 2


def fastest(action: Callable[[], object], repeats: int) -> float:
    """Smallest wall time of several runs, in seconds, after one run to warm up."""
    action()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def peer_views(mesh: Mesh, size: int, views: list[int]) -> int:
    """Cast the rays of some views with Embree and describe the images with OpenCV; returns the number of keypoints."""
    import cv2
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    cv2.setNumThreads(1)
    caster = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    sift = cv2.SIFT.create()
    offsets = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (grid.ravel()[:, None] for grid in np.meshgrid(offsets, -offsets))
    keypoints = 0
    for right, up, eye in CAMERAS[views]:
        origins = x * right + y * up + eye
        hits, rays, _ = caster.intersects_location(origins, np.broadcast_to(-eye, origins.shape), multiple_hits=False)
        depth = np.full(size * size, BACKGROUND, dtype=np.float32)
        depth[rays] = 0.5 * (1 - hits @ eye)
        image = np.round(255 * depth).astype(np.uint8).reshape(size, size)
        keypoints += len(sift.detectAndCompute(image, None)[0])
    return keypoints


def measure() -> list[dict[str, Any]]:
    """Time both, as one row for the speed report."""
    scorer = CMBOF()
    mesh = figure(seed=0, parts=12)
    codebook = scorer.train_codebook([scorer.extract(figure(seed)) for seed in range(3)])
    ours = fastest(lambda: scorer.quantise(scorer.extract(mesh), codebook), repeats=5)

    upright = normalise(mesh, scorer.pose, scorer.image_size)
    images = render(upright, scorer.image_size)
    features = detect_views(images, peak_threshold=scorer.peak_threshold, background=BACKGROUND)
    stages = {
        "pose": lambda: normalise(mesh, scorer.pose, scorer.image_size),
        "views": lambda: render(upright, scorer.image_size),
        "SIFT": lambda: detect_views(images, peak_threshold=scorer.peak_threshold, background=BACKGROUND),
        "words": lambda: scorer.quantise(features, codebook),
    }
    shares = ", ".join(f"{name} {1000 * fastest(stage, 3):.0f} ms" for name, stage in stages.items())

    parts = [list(range(part, N_VIEWS, PEER_PROCESSES)) for part in range(PEER_PROCESSES)]
    with ProcessPoolExecutor(PEER_PROCESSES, mp_context=multiprocessing.get_context("spawn")) as pool:

        def run_peer() -> list[int]:
            tasks = [pool.submit(peer_views, upright, scorer.image_size, part) for part in parts]
            return [task.result() for task in tasks]

        peer = fastest(run_peer, repeats=3)
    per_view = len(features.descriptors) / N_VIEWS
    return [
        {
            "name": "CM-BOF signature of one form",
            "ours_seconds": ours,
            "peer": "trimesh + Embree, then OpenCV SIFT, two processes",
            "peer_seconds": peer,
            "ratio": peer / ours,
            "detail": f"{mesh.n_faces} faces, {per_view:.0f} keypoints per view, one core: {shares}",
        }
    ]


if __name__ == "__main__":
    for row in measure():
        print(row)

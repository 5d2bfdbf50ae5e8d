"""Time to turn a form into its signature, against ray casting followed by OpenCV's SIFT.

Ours is all of it: pose normalisation, 66 depth images, SIFT, and the nearest words. The peer gets the normalised form:
trimesh with Embree casts the same rays, OpenCV describes the eight-bit images at its defaults; no words are looked up.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.geometry.mesh import Mesh
from retrieval.cmbof import CMBOF
from retrieval.features import EDGE_RATIO, _detect_all, _foreground, detect_views
from retrieval.gaussian_blur import gaussian_kernel
from retrieval.gradient_histograms import MAGNIFICATION, SPATIAL_BINS
from retrieval.pose import FIRST_STEP, GRID, LAST_STEP, STARTS, normalise
from retrieval.scale_space import BASE_SCALE, MARGIN, N_GAUSSIANS, NOMINAL_BLUR, SMALLEST_SIDE, STEP
from retrieval.views import BACKGROUND, CAMERAS, N_VIEWS, render
from tests.retrieval.figures import figure
from tools.speed._limits import Limit
from tools.speed._timing import least_seconds, least_wall_seconds, row
from tools.speed.mds import OF_LIMIT

SCORER = CMBOF()
OUR_FORMS = 8
PEER_FORMS = 2
REPEATS = 3
TIMES_FASTER = 4

OPERATIONS_OF_A_FACE = 20
"""Of a face under a rotation: three dot products, their absolute values, and both sums."""

SUMS_OF_A_SAMPLE, SUMS_OF_A_DIRECTION = 8, 2
"""Bins of a histogram to which a pixel around a keypoint adds: of its descriptor, and of its orientation."""


def signature(codebook: NDArray[Any], mesh: Mesh) -> int:
    """Describe one form; returns the number of keypoints."""
    features = SCORER.extract(mesh)
    SCORER.quantise(features, codebook)
    return len(features.descriptors)


def peer_signature(mesh: Mesh) -> int:
    """Cast the rays of all views with Embree and describe the images with OpenCV; returns the number of keypoints."""
    import cv2

    cv2.setNumThreads(1)
    sift = cv2.SIFT.create()
    images = peer_images(mesh, SCORER.image_size, range(N_VIEWS))
    return sum(len(sift.detectAndCompute(np.round(255 * image).astype(np.uint8), None)[0]) for image in images)


def peer_images(mesh: Mesh, size: int, views: Sequence[int]) -> list[NDArray[np.float32]]:
    """Depth images of a normalised form, shape (size, size) each, by Embree."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    caster = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    offsets = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (grid.ravel()[:, None] for grid in np.meshgrid(offsets, -offsets))
    images = []
    for right, up, eye in CAMERAS[list(views)]:
        origins = x * right + y * up + eye
        hits, rays, _ = caster.intersects_location(origins, np.broadcast_to(-eye, origins.shape), multiple_hits=False)
        depth = np.full(size * size, BACKGROUND, dtype=np.float32)
        depth[rays] = 0.5 * (1 - hits @ eye)
        images.append(depth.reshape(size, size))
    return images


def seconds_per_form(describe: Callable[[Mesh], int], forms: Sequence[Mesh], processes: int) -> float:
    """Wall time per form when the forms are shared out evenly among processes, without their start."""
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        share = len(forms) // processes
        return least_wall_seconds(lambda: list(pool.map(describe, forms, chunksize=share)), REPEATS) / len(forms)


def measure() -> list[dict[str, Any]]:
    """Time both on two cores and on one."""
    forms = [figure(seed, parts=12) for seed in range(OUR_FORMS)]
    codebook = SCORER.train_codebook([SCORER.extract(figure(seed)) for seed in range(3)])
    describe = partial(signature, codebook)
    upright = [normalise(form, SCORER.pose, SCORER.image_size) for form in forms[:PEER_FORMS]]
    images = render(upright[0], SCORER.image_size)
    differences = np.abs(images - np.array(peer_images(upright[0], SCORER.image_size, range(N_VIEWS))))
    keypoints = (describe(forms[0]) / N_VIEWS, peer_signature(upright[0]) / N_VIEWS)
    agreement = (
        f"{100 * (differences <= 1e-3).mean():.2f} % of the pixels agree to 0.001 of the depth range, "
        f"{keypoints[0]:.0f} keypoints per view (peer {keypoints[1]:.0f}), {forms[0].n_faces} faces"
    )
    rows = []
    for cores in (2, 1):
        ours = seconds_per_form(describe, forms, cores)
        peer = seconds_per_form(peer_signature, upright, cores)
        rows.append(
            row(
                f"CM-BOF signature on {cores} core{'s' * (cores > 1)}, one form",
                ours,
                clock="wall",
                peer="trimesh + Embree, then OpenCV SIFT",
                peer_seconds=peer,
                target=f"at least {TIMES_FASTER} times faster",
                met=peer >= TIMES_FASTER * ours,
                detail=f"{1 / ours:.2f} forms per second (peer {1 / peer:.2f}), {agreement}",
                forms_per_second=1 / ours,
                peer_forms_per_second=1 / peer,
            )
        )
    return [*rows, *stages(forms[0], upright[0], images, codebook)]


def stages(form: Mesh, upright: Mesh, images: NDArray[np.float32], codebook: NDArray[np.uint8]) -> list[dict[str, Any]]:
    """Time of the four parts of our signature."""
    detect = partial(detect_views, images, peak_threshold=SCORER.peak_threshold, background=BACKGROUND)
    features = detect()
    parts = {
        "pose": lambda: normalise(form, SCORER.pose, SCORER.image_size),
        "views": lambda: render(upright, SCORER.image_size),
        "SIFT": detect,
        "words": lambda: SCORER.quantise(features, codebook),
    }
    times = {name: least_seconds(work, REPEATS) for name, work in parts.items()}
    total, limit = sum(times.values()), least_time(upright, images, words=times["words"])
    return [
        row(
            "CM-BOF signature, sum of its parts",
            total,
            target=f"at most {OF_LIMIT:g} times the limit",
            met=total <= OF_LIMIT * limit.seconds,
            detail=f"{limit}; " + ", ".join(f"{name} {1000 * seconds:.0f} ms" for name, seconds in times.items()),
        )
    ]


def least_time(upright: Mesh, images: NDArray[np.float32], **measured: float) -> Limit:
    """Limit of a signature: rotations tried, pixels drawn, blurred and read, and what is added to histograms.

    Parameters
    ----------
    upright, images
        A form in its pose, and its views.
    **measured
        Seconds of the products of matrices that find the words.
    """
    halvings = int(np.ceil(np.log2(FIRST_STEP / LAST_STEP)))
    # A step is halved when a turn by it helps about none of three axes, either way.
    rotations = GRID**3 + STARTS * halvings * 6
    first, second, third = (upright.vertices[upright.faces[:, k]] for k in range(3))
    areas = 0.5 * np.cross(second - first, third - first) * (images.shape[1] / 2) ** 2
    drawn = np.abs(areas @ CAMERAS[:, 2].T).sum()  # each face, in all 66 views
    frames = _detect_all(images, np.float32(BACKGROUND), SCORER.peak_threshold, EDGE_RATIO)[0]
    octaves = np.floor(np.log2(frames[:, 2] / (BASE_SCALE * STEP**0.5)))
    variances = (frames[:, 2] / 2.0**octaves) ** 2
    samples = SUMS_OF_A_SAMPLE * ((SPATIAL_BINS + 1) * MAGNIFICATION) ** 2 * variances.sum()
    directions = SUMS_OF_A_DIRECTION * np.pi * (3 * 1.5) ** 2 * variances.sum()
    return Limit.of(
        moved=2 * images.nbytes,
        looks=drawn + samples + directions,
        sums=rotations * upright.n_faces * OPERATIONS_OF_A_FACE,
        singles=sum(operations_of_blurs(image) for image in images),
        **measured,
    )


def operations_of_blurs(image: NDArray[np.float32]) -> float:
    """Operations of all blurs of a view: of each pixel, a product and two sums for each weight, once each way."""
    sigmas = [BASE_SCALE * STEP ** (level - 1) * np.sqrt(STEP**2 - 1) for level in range(1, N_GAUSSIANS)]
    top, bottom, left, right = _foreground(image, np.float32(BACKGROUND))
    operations, octave, sides = 0.0, 0, np.array(image.shape)
    while top < bottom and (sides.min() >= SMALLEST_SIDE or octave == 0):
        begins, ends = np.array([top, left]) >> octave, np.array([bottom, right]) >> octave
        window = np.minimum(ends + MARGIN + 1, sides) - np.maximum(begins - MARGIN, 0)
        blurs = [*sigmas, np.sqrt(BASE_SCALE**2 - NOMINAL_BLUR**2)] if octave == 0 else sigmas
        operations += window.prod() * sum(2 * (3 * len(gaussian_kernel(sigma)) - 2) for sigma in blurs)
        octave, sides = octave + 1, sides // 2
    return operations

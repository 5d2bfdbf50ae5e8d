"""CM-BOF: the signature of a form, and the comparison of all pairs of a gallery."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from benchmark.geometry.mesh import Mesh
from retrieval.clock import Signature, count_words, match_all
from retrieval.cmbof import CMBOF
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, view_sphere
from tests.retrieval.figures import figure
from tools.speed.timing import Row, least

N_WORDS, N_FORMS, KEYPOINTS_PER_VIEW, CORES = 1500, 200, 40, 2
PEER_PAIRS, REPEATS = 4, 3
SPHERE = view_sphere(2)
N_VIEWS = len(SPHERE.directions)


def measure() -> Iterator[Row]:
    """One signature on one core, and one pair on one core and on two."""
    scorer = CMBOF()
    form = figure(0, parts=12)
    codebook = scorer.train_codebook([scorer.extract(figure(seed)) for seed in range(3)])
    upright = normalise(form, scorer.pose, scorer.image_size)
    ours = least(lambda: scorer.quantise(scorer.extract(form), codebook), REPEATS)
    peer = least(partial(_embree_and_opencv, upright, scorer.image_size), REPEATS)
    detail = f"{form.n_faces} faces; the peer is given the pose and looks up no words"
    yield Row("CM-BOF signature of one form", ours, detail, "trimesh + Embree, then OpenCV SIFT", peer)

    signatures = _gallery()
    pairs = N_FORMS * (N_FORMS - 1) // 2
    tables = np.zeros((PEER_PAIRS + 1, N_VIEWS, N_WORDS), dtype=np.uint8)
    for table, signature in zip(tables, signatures, strict=False):
        table[signature.views, signature.words] = signature.counts
    dense = least(lambda: [_dense(tables[0], table) for table in tables[1:]], REPEATS) / PEER_PAIRS
    expected = [_dense(tables[0], table) for table in tables[1:]]
    miss = np.abs(match_all(signatures)[0, 1 : PEER_PAIRS + 1] - expected).max()
    detail = f"{N_FORMS} forms, {N_WORDS} words, largest difference {miss:.0e}"
    one = least(lambda: match_all(signatures, 1), REPEATS) / pairs
    yield Row("clock matching, one pair", one, detail, "definition in dense numpy", dense)
    two = least(lambda: match_all(signatures, CORES), REPEATS, time.perf_counter) / pairs
    yield Row(f"clock matching on {CORES} cores, one pair", two, f"{1 / two:.0f} pairs per second", clock="wall")


def _embree_and_opencv(mesh: Mesh, size: int) -> None:
    """Cast the rays of all views of a normalised form with Embree and describe the images with OpenCV."""
    cv2.setNumThreads(1)
    sift = cv2.SIFT.create()
    caster = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    offsets = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (grid.ravel()[:, None] for grid in np.meshgrid(offsets, -offsets))
    for right, up, eye in SPHERE.cameras:
        origins = x * right + y * up + eye
        hits, rays, _ = caster.intersects_location(origins, np.broadcast_to(-eye, origins.shape), multiple_hits=False)
        depth = np.full(size * size, BACKGROUND, dtype=np.float32)
        depth[rays] = 0.5 * (1 - hits @ eye)
        sift.detectAndCompute(np.round(255 * depth.reshape(size, size)).astype(np.uint8), None)


def _gallery() -> list[Signature]:
    """Signatures with as many keypoints as real ones; words are as unequally frequent (log-normal) as real ones."""
    random = np.random.default_rng(0)
    common = random.normal(size=N_WORDS)
    signatures = []
    for _ in range(N_FORMS):
        weights = np.exp(common + random.normal(size=N_WORDS))
        sizes = random.poisson(KEYPOINTS_PER_VIEW, N_VIEWS)
        words = random.choice(N_WORDS, sizes.sum(), p=weights / weights.sum()).astype(np.int32)
        signatures.append(count_words(words, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), N_WORDS))
    return signatures


def _dense(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Clock matching of two tables of word counts, each of shape (66, n_words), straight from the definition."""
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    shared = np.array([np.minimum(view, second).sum(axis=1) for view in first])
    dissimilarity = 1 - shared / larger
    return float(min(dissimilarity[np.arange(N_VIEWS), turn].sum() for turn in SPHERE.permutations))

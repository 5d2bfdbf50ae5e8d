"""Time from one frame of a depth camera, 640 x 480 with a mask, to the prediction, the form and the signature."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from benchmark.datasets.humans import Humans
from benchmark.depth.frame import FrameFiles, observe
from benchmark.depth.mask import Mask, read_mask
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.reading import Depths, read_depth
from benchmark.depth.scene import KINECT, DepthFaults, Pose, Scene
from benchmark.depth_forms import form_of_object, method_of_depth
from benchmark.geometry.depth import render_depth
from benchmark.jobs.stages.features import extract
from benchmark.methods.scorers import ScorerSpec
from learned.streamed.methods import StreamedLearner
from learned.streamed.model import load_streamed, predicted
from tools.speed._timing import least_seconds, row

REPEATS = 7
TO_PREDICTION, TO_FORM, TO_SIGNATURE = 0.05, 0.12, 0.25
"""Seconds that we set out to reach."""


def written(folder: Path) -> FrameFiles:
    """A frame of a generated body before floor and wall, with the faults of a camera, and its mask."""
    dataset = Humans()
    body = dataset.load(dataset.entries[4])
    centred = body.vertices - [*(body.vertices.min(axis=0) + body.vertices.max(axis=0))[:2] / 2, 0]
    scene = Scene(body.with_vertices(centred - [0, 0, centred[:, 2].min()]), Pose((0.2, -2.5, 1.2), (0, 0, 0.8), 3.0))
    depths, mask = scene.drawn(KINECT)
    measured = DepthFaults().perturbed(depths, np.random.default_rng(0))
    Image.fromarray(np.round(1000 * measured).astype(np.uint16)).save(folder / "0.png")
    Image.fromarray(mask).save(folder / "mask.png")
    return FrameFiles(folder / "0.png", KINECT, folder / "mask.png")


def _open3d_seconds(depths: Depths, mask: Mask) -> float | None:
    """Seconds of Open3D from depths to points and their normals, what it offers of that stage; None without it."""
    try:
        import open3d
    except ImportError:
        return None
    (height, width), camera = depths.shape, KINECT
    intrinsic = open3d.camera.PinholeCameraIntrinsic(width, height, camera.fx, camera.fy, camera.cx, camera.cy)
    image = open3d.geometry.Image(np.where(mask, depths, 0).astype(np.float32))

    def points_and_normals() -> object:
        cloud = open3d.geometry.PointCloud.create_from_depth_image(image, intrinsic, depth_scale=1.0)
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(9))
        return cloud

    return least_seconds(points_and_normals, REPEATS)


def _stages(files: FrameFiles) -> list[dict[str, Any]]:
    assert files.mask is not None
    depths, mask = read_depth(files.image), read_mask(files.mask)
    observed = files.observe()
    method = method_of_depth("learned-streamed")
    assert isinstance(method, StreamedLearner)
    network = load_streamed(method.model_folder)
    image = render_depth(observed.surface, UPRIGHT, HALF_WIDTH)
    form = form_of_object(observed, method)
    scorer = ScorerSpec().create()
    pixels = int(np.count_nonzero(observed.mask))

    def to_prediction() -> object:
        return predicted(*network, render_depth(files.observe().surface, UPRIGHT, HALF_WIDTH))

    def to_form() -> object:
        return form_of_object(files.observe(), method)

    def to_signature() -> object:
        return extract(scorer, form_of_object(files.observe(), method).form.mesh)

    without_mask = replace(files, mask=None)
    stages: tuple[tuple[str, Callable[[], object], float | None], ...] = (
        ("reading depth and mask", lambda: (read_depth(files.image), read_mask(files.mask or Path())), None),
        ("object, with its mask", lambda: observe(depths, KINECT, mask), None),
        ("object, by the rule", lambda: observe(depths, KINECT), None),
        ("depth image of 500 x 500", lambda: render_depth(observed.surface, UPRIGHT, HALF_WIDTH), None),
        ("prediction", lambda: predicted(*network, image), None),
        ("signature", lambda: extract(scorer, form.form.mesh), None),
        ("file to prediction", to_prediction, TO_PREDICTION),
        ("file to form", to_form, TO_FORM),
        ("file to signature", to_signature, TO_SIGNATURE),
        ("file to form, without a mask", lambda: form_of_object(without_mask.observe(), method), None),
    )
    rows = []
    peers = {"object, with its mask": ("Open3D, points and normals of 9 neighbours", _open3d_seconds(depths, mask))}
    for name, work, most in stages:
        seconds = least_seconds(work, REPEATS)
        peer, peer_seconds = peers.get(name, (None, None))
        rows.append(
            row(
                f"frame of a depth camera, {name}",
                seconds,
                target="none" if most is None else f"at most {1000 * most:g} ms",
                met=most is None or seconds <= most,
                peer=peer if peer_seconds else None,
                peer_seconds=peer_seconds,
                detail=f"640 x 480 pixels, {pixels} of the object, float64 but for the network, warm",
            )
        )
    return rows


def measure() -> list[dict[str, Any]]:
    """Time each stage on one core."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with tempfile.TemporaryDirectory() as folder:
            return _stages(written(Path(folder)))
    finally:
        torch.set_num_threads(threads)

"""Preparation of meshes, one frame of a depth camera, and the start of the command line."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pymeshlab
import torch
from PIL import Image

from benchmark.datasets.humans import Humans
from benchmark.depth.frame import FrameFiles
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.scene import KINECT, DepthFaults, Pose, Scene
from benchmark.depth_forms import form_of_object, method_of_depth
from benchmark.geometry.depth import render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from benchmark.plugins.output_checks import signature_of
from benchmark.plugins.scorers import ScorerSpec
from learned.streamed.methods import StreamedLearner
from learned.streamed.model import load_streamed, predicted
from tools.speed.timing import Row, alternately, least

VERTICES, REPEATS = 2000, 3
VERBS = (("--help",), ("list", "methods"))


def measure() -> Iterator[Row]:
    """One mesh, one frame, and two verbs that must answer at once."""
    humans = Humans()
    mesh = humans.load(humans.entries[7])
    ours, peer = alternately(partial(prepare, mesh, VERTICES), partial(_collapsed, mesh), REPEATS)
    detail = f"from {mesh.n_vertices} to {VERTICES} vertices"
    yield Row("preparation of one mesh", ours, detail, "pymeshlab quadric edge collapse alone", peer)
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        yield from _frame(_written(Path(folder)))
    bare = least(partial(_run, "-c", "pass"), REPEATS, time.perf_counter)
    for words in VERBS:
        seconds = least(partial(_run, "-m", "benchmark", *words), REPEATS, time.perf_counter)
        name = f"python -m benchmark {' '.join(words)}"
        yield Row(name, seconds, "the start of the interpreter is the floor", "python -c pass", bare, "wall")


def _collapsed(mesh: Mesh) -> None:
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=2 * VERTICES)


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)


def _written(folder: Path) -> FrameFiles:
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


def _frame(files: FrameFiles) -> Iterator[Row]:
    """From the files of a frame to the prediction, the form and the signature, all warm."""
    method, scorer = method_of_depth("learned-streamed"), ScorerSpec().create()
    assert isinstance(method, StreamedLearner)
    network = load_streamed(method.model_folder)
    steps = {
        "prediction": lambda: predicted(*network, render_depth(files.observe().surface, UPRIGHT, HALF_WIDTH)),
        "form": lambda: form_of_object(files.observe(), method),
        "signature": lambda: signature_of(scorer, form_of_object(files.observe(), method).form.mesh),
    }
    for name, work in steps.items():
        yield Row(f"frame of a depth camera, file to {name}", least(work, REPEATS), "640 x 480 pixels, with a mask")

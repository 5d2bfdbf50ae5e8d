"""``python -m tools.speed [GROUP ...]``: this suite beside other programs, measured in one run as one table."""
# ruff: noqa: E402

from __future__ import annotations

from benchmark.machine import pin_threads

pin_threads()

import multiprocessing
import platform
import re
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import igl
import numpy as np
import psutil
import pymeshlab
import torch
import trimesh
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse.linalg import eigsh
from sklearn.manifold import smacof as sklearn_smacof
from trimesh.ray.ray_pyembree import RayMeshIntersector

from baselines._kernels.arap import AsRigidAsPossible
from baselines._kernels.smacof import normalised_stress, smacof
from baselines.classic_mds import classic_scaling
from baselines.non_metric_mds import non_metric_scaling
from benchmark.api.contracts import Mesh, Shape
from benchmark.datasets.humans import Humans
from benchmark.depth.frame import FrameFiles
from benchmark.depth.projection import HALF_WIDTH, UPRIGHT
from benchmark.depth.scene import KINECT, DepthFaults, Pose, Scene
from benchmark.depth_forms import form_of_object, method_of_depth
from benchmark.geometry import geodesics
from benchmark.geometry.depth import render_depth
from benchmark.geometry.preparation import prepare
from benchmark.plugins.output_checks import signature_of
from benchmark.plugins.registry import methods, variant
from benchmark.plugins.scorers import ScorerSpec
from benchmark.report.escaping import markdown_table
from learned.images import enlarge, shrink
from learned.paired.configuration import LITERAL
from learned.paired.model import predict
from learned.paired.network import build
from learned.paired.pairs import Pairs
from learned.paired.schedule import Schedule, losses
from learned.paired.training import train
from learned.streamed.model import load_streamed, predicted
from learned.training.loop import TrainingRun
from learned.training.machine import Precision, has_bfloat16
from retrieval.clock import Signature, count_words, match_all
from retrieval.cmbof import CMBOF
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, view_sphere
from tests.baselines.deformable import tube
from tests.learned.toy import person
from tests.retrieval.figures import figure

HEADER = ("what", "ours", "other program", "its time", "ratio", "clock", "how it was measured")
FloatArray = NDArray[np.float64]
readable = EngFormatter("s", places=2)


class Row(NamedTuple):
    """One measurement: seconds of ours and of another program, and what makes the comparison fair."""

    name: str
    seconds: float
    detail: str
    peer: str = ""
    peer_seconds: float = 0.0
    clock: str = "processor"

    def cells(self) -> tuple[str, ...]:
        peer = (self.peer, readable(self.peer_seconds), f"{self.peer_seconds / self.seconds:.2f}")
        return (self.name, readable(self.seconds), *(peer if self.peer else ("", "", "")), self.clock, self.detail)


def least(work: Callable[[], object], repeats: int = 3, clock: Callable[[], float] = time.process_time) -> float:
    """Least time of some runs, after one that compiles and fills the caches."""
    work()
    return min(timeit.repeat(work, timer=clock, number=1, repeat=repeats))


def human(place: int) -> Mesh:
    humans = Humans()
    return humans.load(humans.entries[place])


def measure_geodesics(n_shapes: int = 10, n_sources: int = 50) -> Iterator[Row]:
    """Median over prepared humans; errors are relative to exact distances from some vertices."""
    random = np.random.default_rng(0)
    meshes = [
        prepare(human(place)).mesh for place in np.linspace(0, len(Humans().entries) - 1, n_shapes).round().astype(int)
    ]
    sources = random.choice(min(mesh.n_vertices for mesh in meshes), n_sources, replace=False)
    exact = [geodesics.from_sources(mesh, sources, "exact") for mesh in meshes]
    seconds, errors = {}, {}
    for solver in (geodesics.DEFAULT_SOLVER, "heat"):
        seconds[solver] = float(np.median([least(partial(geodesics.all_pairs, m, solver), 2) for m in meshes]))
        misses = [
            np.abs(geodesics.all_pairs(mesh, solver)[sources] - truth)[truth > 0] / truth[truth > 0]
            for mesh, truth in zip(meshes, exact, strict=True)
        ]
        errors[solver] = 100 * np.concatenate(misses).mean()
    ours = geodesics.DEFAULT_SOLVER
    detail = f"{n_shapes} shapes of 2000 vertices, mean error {errors[ours]:.3f} % (peer {errors['heat']:.2f} %)"
    yield Row("all geodesics of one shape", seconds[ours], detail, "potpourri3d heat method", seconds["heat"])


def measure_forms(non_metric_iterations: int = 10) -> Iterator[Row]:
    """Methods given the geodesics, those that ask for a few rows of them, and the elastic step."""
    shape = Shape(identifier="body", mesh=prepare(human(-1)).mesh)
    distances = shape.geodesics()
    known = methods()
    classic, full, non_metric = (
        variant(name, known).create() for name in ("classic-mds", "least-squares-mds", "non-metric-mds")
    )
    ours, peer = (least(partial(scaling, distances), 5) for scaling in (classic_scaling, arpack_scaling))
    detail = "the three largest eigenpairs of 2000 vertices"
    yield Row("classic-mds, given the geodesics", ours, detail, "double centring + scipy eigsh", peer)

    # scikit-learn starts at the same vertices and stops where plain majorisation stops.
    start = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    theirs = partial(sklearn_scaling, distances, start, smacof(distances, start).iterations)
    stresses = full.canonicalise(shape).notes["stress"], normalised_stress(theirs(), distances)
    detail = "stress {:.5f} (peer {:.5f})".format(*stresses)
    ours = least(partial(full.canonicalise, shape), 5)
    yield Row("least-squares-mds, given the geodesics", ours, detail, "sklearn.manifold.smacof", least(theirs, 1))

    # Its whole non-metric scaling takes minutes, and leaves the scale to the number of points.
    start = classic.canonicalise(shape).vertices
    theirs = partial(sklearn_scaling, distances, start, non_metric_iterations, metric=False)
    points = theirs()
    points *= np.linalg.norm(start) / np.linalg.norm(points)
    stress = non_metric_scaling(distances, points, max_iterations=0)[1][0]
    detail = f"root of the stress {non_metric.canonicalise(shape).notes['stress_1']:.5f} (peer {stress:.5f})"
    name = f"sklearn.manifold.smacof(metric=False), {non_metric_iterations} iterations"
    ours = least(partial(non_metric.canonicalise, shape), 5)
    yield Row("non-metric-mds, given the geodesics", ours, detail, name, least(theirs, 1))

    all_pairs = least(partial(form_of_mesh, classic, shape.mesh), 5)
    for name in ("accelerated-mds", "fast-classical-scaling", "nystrom-mds", "fast-mds"):
        method = variant(name, known).create()
        stresses = [normalised_stress(m.canonicalise(shape).vertices, distances) for m in (method, classic)]
        detail = "stress over all pairs {:.5f} (peer {:.5f})".format(*stresses)
        ours = least(partial(form_of_mesh, method, shape.mesh), 5)
        yield Row(f"{name} with its geodesics", ours, detail, "all geodesics + classic-mds", all_pairs)
    yield elastic_steps()


def form_of_mesh(method: Any, mesh: Mesh) -> object:
    """The form of a new mesh, for which no geodesic graph is remembered."""
    return method.canonicalise(Shape(identifier="body", mesh=Mesh(mesh.vertices.copy(), mesh.faces.copy())))


def arpack_scaling(distances: FloatArray) -> FloatArray:
    squared = distances**2
    means = squared.mean(axis=0)
    values, vectors = eigsh(-0.5 * (squared - means - means[:, None] + means.mean()), k=3, which="LA")
    return np.asarray(vectors[:, ::-1] * np.sqrt(values[::-1]))


def sklearn_scaling(distances: FloatArray, start: FloatArray, iterations: int, *, metric: bool = True) -> FloatArray:
    options = {"n_components": 3, "n_init": 1, "max_iter": iterations, "eps": 0}
    return np.asarray(sklearn_smacof(distances, metric=metric, init=start, **options)[0])


def elastic_steps(steps: int = 50) -> Row:
    """As many local and global steps as libigl takes, from the same start under the same handles.

    The tube has no obtuse pair of angles, whose negative weights libigl keeps: both minimise the same energy.
    """
    mesh = tube(1.0, rings=84, sides=24)
    order = mesh.vertices[:, 0].argsort()
    handles = np.concatenate([order[:20], order[-20:]])
    start, targets, pull = mesh.vertices.copy(), np.zeros_like(mesh.vertices), np.zeros(mesh.n_vertices)
    goals = mesh.vertices[handles] + np.repeat([[0.0, 0.0, 0.2], [0.0, 0.0, -0.2]], 20, axis=0)
    start[handles] = targets[handles] = goals
    pull[handles] = 1e6
    surface = AsRigidAsPossible.of(Shape(identifier="tube", mesh=mesh))

    def ours() -> FloatArray:
        solve, positions = surface.factorise(pull), start
        for _ in range(steps):
            positions = solve(surface.load(surface.rotations(positions)) + pull[:, None] * targets)
        return positions

    def peer() -> FloatArray:
        data = igl.ARAPData()
        data.energy, data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES, steps
        igl.arap_precomputation(mesh.vertices, mesh.faces.astype(np.int64), 3, handles.astype(np.int32), data)
        return np.asarray(igl.arap_solve(goals, data, mesh.vertices.copy()))

    difference = float(np.linalg.norm(ours() - peer(), axis=1).mean())
    detail = f"{mesh.n_vertices} vertices, mean distance between the results {difference:.0e}"
    name = f"as-rigid-as-possible, {steps} steps"
    return Row(name, least(ours, 5), detail, "libigl ARAP (spokes)", least(peer, 5))


SPHERE = view_sphere(2)
N_VIEWS = len(SPHERE.directions)


def measure_scorer(n_words: int = 1500, n_forms: int = 200, n_peers: int = 4) -> Iterator[Row]:
    """One signature on one core, and one pair on one core and on two."""
    scorer = CMBOF()
    form = figure(0, parts=12)
    codebook = scorer.train_codebook([scorer.extract(figure(seed)) for seed in range(3)])
    peer = least(partial(embree_and_opencv, normalise(form, scorer.pose, scorer.image_size), scorer.image_size))
    detail = f"{form.n_faces} faces; the peer is given the pose and looks up no words"
    ours = least(lambda: scorer.quantise(scorer.extract(form), codebook))
    yield Row("CM-BOF signature of one form", ours, detail, "trimesh + Embree, then OpenCV SIFT", peer)

    signatures, n_pairs = word_counts(n_words, n_forms), n_forms * (n_forms - 1) // 2
    tables = np.zeros((n_peers + 1, N_VIEWS, n_words), dtype=np.uint8)
    for table, signature in zip(tables, signatures, strict=False):
        table[signature.views, signature.words] = signature.counts
    dense = least(lambda: [dense_matching(tables[0], table) for table in tables[1:]]) / n_peers
    expected = [dense_matching(tables[0], table) for table in tables[1:]]
    miss = np.abs(match_all(signatures)[0, 1 : n_peers + 1] - expected).max()
    detail = f"{n_forms} forms, {n_words} words, largest difference {miss:.0e}"
    one = least(lambda: match_all(signatures, 1)) / n_pairs
    yield Row("clock matching, one pair", one, detail, "definition in dense numpy", dense)
    two = least(lambda: match_all(signatures, 2), clock=time.perf_counter) / n_pairs
    yield Row("clock matching on 2 cores, one pair", two, f"{1 / two:.0f} pairs per second", clock="wall")


def embree_and_opencv(mesh: Mesh, size: int) -> None:
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


def word_counts(n_words: int, n_forms: int) -> list[Signature]:
    """Signatures with as many keypoints as real ones; words are as unequally frequent (log-normal) as real ones."""
    random = np.random.default_rng(0)
    common = random.normal(size=n_words)
    signatures = []
    for _ in range(n_forms):
        weights = np.exp(common + random.normal(size=n_words))
        sizes = random.poisson(40, N_VIEWS)
        words = random.choice(n_words, sizes.sum(), p=weights / weights.sum()).astype(np.int32)
        signatures.append(count_words(words, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), n_words))
    return signatures


def dense_matching(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Clock matching of two tables of word counts, each of shape (66, n_words), straight from the definition."""
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    shared = np.array([np.minimum(view, second).sum(axis=1) for view in first])
    dissimilarity = 1 - shared / larger
    return float(min(dissimilarity[np.arange(N_VIEWS), turn].sum() for turn in SPHERE.permutations))


BATCH, RESOLUTION = 8, 128
PRECISION: Precision = "bfloat16" if has_bfloat16(torch.device("cpu")) else "float32"
TORCH = "torch, float32, contiguous memory"


def measure_network() -> Iterator[Row]:
    """A prediction and a step of training on one core."""
    torch.set_num_threads(1)
    contiguous, network = build(LITERAL).eval(), build(LITERAL).to(memory_format=torch.channels_last).eval()
    image = person()
    small = torch.from_numpy(shrink(image, RESOLUTION)[:1])
    with torch.inference_mode():
        peer = least(lambda: contiguous(small[None])[0])
    ours = least(lambda: enlarge(predict(network, torch.from_numpy(shrink(image, RESOLUTION)[:1]))))
    detail = f"from depth image to depth image of 500 x 500 pixels, by a network at {RESOLUTION} x {RESOLUTION}"
    yield Row("prediction of one image", ours, detail, f"{TORCH}, the network alone", peer)
    # In new processes: our loop changes, for the whole of its process, how memory is allocated.
    new = multiprocessing.get_context("spawn")
    times = []
    for training in (suite_training, plain_training):
        with ProcessPoolExecutor(1, mp_context=new, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            times.append(pool.submit(step_seconds, training).result())
    detail = f"{PRECISION}, {RESOLUTION} x {RESOLUTION}, {BATCH / times[0]:.3g} images per second"
    yield Row(f"training, one step of {BATCH} images", times[0], detail, TORCH, times[1])


def suite_training(batch: Pairs, schedule: Schedule) -> None:
    with tempfile.TemporaryDirectory() as folder:
        here = TrainingRun(folder=Path(folder), recipe={}, seed=0, device=torch.device("cpu"), say=lambda _: None)
        train(LITERAL, schedule, batch, None, here)


def plain_training(batch: Pairs, schedule: Schedule) -> None:
    """The loop of a tutorial."""
    network = build(LITERAL)
    optimiser = torch.optim.Adam(network.parameters(), lr=schedule.learning_rate)
    for _ in range(schedule.epochs):
        optimiser.zero_grad()
        torch.stack(losses(network(batch.images), batch.targets, "all")).sum().backward()
        optimiser.step()


def step_seconds(training: Callable[[Pairs, Schedule], None], more_steps: int = 4) -> float:
    """Time of one step: the difference between a training of one step and a longer one, over the steps of that."""
    torch.manual_seed(0)
    images, targets = (torch.rand(BATCH, channels, RESOLUTION, RESOLUTION) for channels in (1, 2))
    batch = Pairs(tuple(map(str, range(BATCH))), images, targets.round(), torch.arange(BATCH))
    schedule = partial(Schedule, resolution=RESOLUTION, early_epochs=0, batch=BATCH, precision=PRECISION)
    # As many epochs as steps, for each has one batch.
    short, long = (least(partial(training, batch, schedule(epochs=n))) for n in (1, 1 + more_steps))
    return (long - short) / more_steps


def measure_programs() -> Iterator[Row]:
    """One mesh, one frame from its files on, and two verbs that must answer at once."""
    mesh = human(7)
    detail = f"from {mesh.n_vertices} to 2000 vertices"
    ours, peer = least(partial(prepare, mesh, 2000)), least(partial(collapsed, mesh))
    yield Row("preparation of one mesh", ours, detail, "pymeshlab quadric edge collapse alone", peer)

    torch.set_num_threads(1)
    method: Any = method_of_depth("learned-streamed")
    scorer, network = ScorerSpec().create(), load_streamed(method.model_folder)
    with tempfile.TemporaryDirectory() as folder:
        files = frame_files(Path(folder))
        steps = {
            "prediction": lambda: predicted(*network, render_depth(files.observe().surface, UPRIGHT, HALF_WIDTH)),
            "form": lambda: form_of_object(files.observe(), method),
            "signature": lambda: signature_of(scorer, form_of_object(files.observe(), method).form.mesh),
        }
        for name, work in steps.items():
            yield Row(f"frame of a depth camera, file to {name}", least(work), "640 x 480 pixels, with a mask")

    def start(*arguments: str) -> float:
        command = [sys.executable, *arguments]
        return least(partial(subprocess.run, command, check=True, capture_output=True), clock=time.perf_counter)

    bare, detail = start("-c", "pass"), "the start of the interpreter is the floor"
    for words in (("--help",), ("list", "methods")):
        ours = start("-m", "benchmark", *words)
        yield Row(f"python -m benchmark {' '.join(words)}", ours, detail, "python -c pass", bare, "wall")


def collapsed(mesh: Mesh) -> None:
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=4000)


def frame_files(folder: Path) -> FrameFiles:
    """A frame of a generated body before floor and wall, with the faults of a camera, and its mask."""
    body = human(4)
    centred = body.vertices - [*(body.vertices.min(axis=0) + body.vertices.max(axis=0))[:2] / 2, 0]
    scene = Scene(body.with_vertices(centred - [0, 0, centred[:, 2].min()]), Pose((0.2, -2.5, 1.2), (0, 0, 0.8), 3.0))
    depths, mask = scene.drawn(KINECT)
    measured = DepthFaults().perturbed(depths, np.random.default_rng(0))
    Image.fromarray(np.round(1000 * measured).astype(np.uint16)).save(folder / "0.png")
    Image.fromarray(mask).save(folder / "mask.png")
    return FrameFiles(folder / "0.png", KINECT, folder / "mask.png")


GROUPS: dict[str, Callable[[], Iterator[Row]]] = {
    "geodesics": measure_geodesics,
    "forms": measure_forms,
    "scorer": measure_scorer,
    "network": measure_network,
    "programs": measure_programs,
}


def main() -> None:
    """Print each row as it is measured to stderr, and the table in the end."""
    if unknown := {*sys.argv[1:]} - {*GROUPS}:
        sys.exit(f"no group {min(unknown)}; choose from {', '.join(GROUPS)}")
    rows = []
    for group in sys.argv[1:] or GROUPS:
        for row in GROUPS[group]():
            rows.append(row.cells())
            print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    print(markdown_table(HEADER, rows, n_left=len(HEADER)))
    processor = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    print(f"\nMeasured on {platform.platform()} ({processor and processor[1]}), {psutil.cpu_count()} cores.")


if __name__ == "__main__":
    main()

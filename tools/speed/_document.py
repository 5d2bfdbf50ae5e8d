"""``docs/appendix/speed.md`` out of ``results/speed.json`` and ``results/growth.json``: no figure is typed."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmark.report.escaping import markdown_table

SPEED = Path("results/speed.json")
GROWTH = Path("results/growth.json")
DECIMATION = Path("results/decimation.json")
FIGURE = Path("results/figures/growth.png")
DOCUMENT = Path("docs/appendix/speed.md")
UNITS = (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6))

INTRODUCTION = """\
# Speed

After this page you can say how fast each part is beside other programs, and how time grows with the number of vertices.
Written by `python -m tools.speed` and `python -m tools.speed.growth`; do not edit.
"""

COMPARISONS = """\
## Against other programs

The ratio is the time of the other program over ours, both measured in one run on one machine: above 1, ours is faster.
Processor time is that of one thread and hardly affected by other work; wall time is used where several processes or
threads share the work, or a process starts. Before the semicolon stands what we set out to reach, behind it what makes
the comparison fair. The command is `make speed`.
"""

PROFILES = """\
## Where the time goes

- **Signature.** Blurs, the search for extrema and rows of samples are written in vectors; sums into histograms are half
  of a descriptor's time.
- **Least-squares and non-metric MDS.** 256 spread vertices are scaled first, then all take quasi-Newton steps: five or
  six passes over all pairs instead of up to a hundred, to a lower stress.
- **Clock matching.** View by view, the table of a block of forms fits the first-level cache.
- **All geodesics.** Shortest paths take 70 %; 512 sources advance together.
- **Preparation.** Four fifths are the quadric edge collapse of pymeshlab; [another program](#decimation) takes less.
- **Scan-like bodies.** About two thirds are one call of pymeshlab that makes triangles of one size, a quarter is the
  boundary of the solid. A body is made once for both inputs. To take less time than that call, other triangles would
  be needed.
"""

LIMITS = """\
## Limits

Where a mark was missed, a limit stands in its place: the time in which this machine can move the bytes of the method
and do its operations, at rates measured in the same run (a copy of 64 MiB, square roots with quotients, values found by
index, a matrix in the cache times a vector). The target is three times that, for the rates are those of simple
loops, which the steps of a method never reach together.

- **Non-metric MDS** passes seven times over two million pairs: 72 bytes, a root, a quotient and six vertices found by
  index each time; before that the pairs are sorted by three digits, 100 bytes each.
- **Methods of a few rows** build the same geodesic graph as all pairs, which alone takes about a sixth of the time of
  all pairs with classic MDS: nothing that needs it can be more than about six times faster.
- **Spectral MDS** asks for a hundred eigenpairs beside: 203 steps, each a solve with the factor of the Laplacian and
  a product with all vectors so far, forth and back. What its default misses is the stress: 75 samples instead of 50
  bring it within the bound in 1.05 times the time, `-m "spectral-mds[samples=75]"`.
- **The signature** missed 60 ms. It tries at least 1545 rotations on all faces, draws 66 views, blurs the window of
  each five or six times an octave, and adds each pixel around a keypoint to ten bins. The words are the time of the
  product that finds them.
"""

DECIMATIONS = """\
## Decimation

Programs that collapse edges until 2000 vertices remain, means over the shapes of a set. Distances between the surfaces,
both ways, are in ten-thousandths of the root of the area, the largest over all shapes; *angle*: one in a hundred faces
has one smaller than this; *faults*: shapes with a duplicate face or an edge or vertex that is no manifold, which
preparation then opens or drops. Published rows have pymeshlab, which keeps triangles well shaped; the others are
`-d "NAME[decimation=PROGRAM]"`. The command is `python -m tools.speed.decimation`.
"""

SIZES = """\
## Against the number of vertices

Processor seconds of one thread, so that other work on the machine matters little, for one generated human body
decimated to n vertices: the least of {repeats} runs, or a single one beyond {long_run:g} s. Compiling is not counted.
The geodesics of all pairs are a row of their own and not counted in the methods that take them; a method marked * asks
for a few rows of geodesics instead, which are counted. The last column is the exponent k of n^k between the two largest
sizes. A method that needs more than {limit:g} s stops there; forms are not made of the largest size, where a matrix of
all pairs is more than 1 GB. The command is `python -m tools.speed.growth`.

![Time against the number of vertices](../../{figure})
"""


def machine() -> dict[str, Any]:
    """Describe where the measurements were made."""
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "python": platform.python_version(),
        "cores": psutil.cpu_count(),
    }


def _processor() -> str:
    """Name and width of the vectors, by which figures differ most from machine to machine."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    facts = dict((part.strip() for part in line.split(":", 1)) for line in lines if ":" in line)
    wide = ", AVX-512" if "avx512f" in facts.get("flags", "").split() else ""
    return f"{facts.get('model name', platform.processor())}{wide}"


def write_document() -> Path:
    """Write the tables of all results that exist; returns the path."""
    parts = [INTRODUCTION]
    if SPEED.exists():
        parts += [COMPARISONS, speed_table(json.loads(SPEED.read_text())), LIMITS, PROFILES]
    if DECIMATION.exists():
        found = json.loads(DECIMATION.read_text())
        parts += [DECIMATIONS, decimation_table(found["rows"]), _place(found["machine"])]
    if GROWTH.exists():
        found = json.loads(GROWTH.read_text())
        words = SIZES.format(**found["settings"], figure=FIGURE.as_posix())
        parts += [
            words,
            growth_table(found["sizes"], found["rows"], found["settings"]["limit"]),
            _place(found["machine"]),
        ]
    DOCUMENT.write_text("\n".join(parts))
    return DOCUMENT


def speed_table(found: dict[str, Any]) -> str:
    """The comparisons, as Markdown."""
    rows = [
        (
            measured["name"],
            _seconds(measured["ours_seconds"]),
            measured["peer"] or "",
            _seconds(measured["peer_seconds"]),
            f"{measured['ratio']:.2f}" if measured["ratio"] else "",
            measured["clock"],
            "yes" if measured["met"] else "**no**",
            measured["detail"].removeprefix("target: "),
        )
        for measured in found["rows"]
    ]
    header = (
        "what",
        "ours",
        "other program",
        "its time",
        "ratio",
        "clock",
        "target met",
        "target; how it was measured",
    )
    places: dict[str, list[str]] = {}
    for measured in found["rows"]:
        places.setdefault(_place(measured.get("machine", found["machine"])), []).append(measured["name"])
    if len(places) == 1:
        return _table(header, rows) + "\n" + next(iter(places))
    notes = (f"{place.strip()[:-1]}: {'; '.join(names)}.\n" for place, names in places.items())
    return _table(header, rows) + "\n" + "\n".join(notes)


def decimation_table(rows: Iterable[dict[str, Any]]) -> str:
    """Programs on each set, as Markdown."""
    header = ("set", "shapes", "program", "time", "mean distance", "largest distance", "angle", "faults")
    lines = [
        (
            f"{each['set']}, {each['vertices']} vertices",
            str(each["shapes"]),
            each["program"],
            _seconds(each["seconds"]),
            f"{1e4 * each['mean']:.2f}",
            f"{1e4 * each['largest']:.0f}",
            f"{each['angle']:.1f}°",
            str(each["non_manifold"]),
        )
        for each in rows
    ]
    return _table(header, lines)


def growth_table(sizes: Sequence[int], rows: Iterable[dict[str, Any]], limit: float) -> str:
    """Time against n, as Markdown; a row that ends early was stopped where it took longer than the limit."""
    lines = []
    for each in rows:
        cells = [each["name"] + " *" * each["takes_rows"]]
        cells += [_seconds(seconds) for seconds in each["seconds"]]
        cells += ["stopped" if each["seconds"][-1] > limit else ""] * (len(sizes) + 1 - len(cells))
        lines.append((*cells, exponent(sizes, each["seconds"])))
    return _table(("", *(f"n = {size}" for size in sizes), "k"), lines)


def exponent(sizes: Sequence[int], seconds: Sequence[float]) -> str:
    """Exponent of the growth between the two largest sizes, where the time is long enough to tell."""
    if len(seconds) < 2 or seconds[-2] < 1e-3:
        return ""
    last = len(seconds) - 1
    return f"{np.log(seconds[last] / seconds[last - 1]) / np.log(sizes[last] / sizes[last - 1]):.1f}"


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return ""
    unit, scale = next((pair for pair in UNITS if seconds >= pair[1]), UNITS[-1])
    return f"{seconds / scale:.3g} {unit}"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(markdown_table(header, rows, n_left=len(header))) + "\n"


def _place(found: dict[str, Any]) -> str:
    processor = f" ({found['processor']})" if found.get("processor") else ""
    return f"Measured on {found['system']}{processor}, Python {found['python']}, {found['cores']} cores.\n"

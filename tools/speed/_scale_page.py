"""``docs/appendix/scale.md`` and its figure, out of what ``tools.speed.scale`` has measured: no figure is typed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from benchmark.report.escaping import markdown_table

ROOT = Path(__file__).parents[2]
RECALL = ROOT / "results" / "recall.json"
PAGE, FIGURE = ROOT / "docs" / "appendix" / "scale.md", ROOT / "results" / "figures" / "scale.png"

#: Sizes of the page; those that were not run are extrapolated.
SIZES = (100, 1000, 4000, 10_000)
#: Sizes beyond, in a table of their own.
BEYOND = (10_000, 100_000, 1_000_000)
#: What was run.
POSES = 20
METHODS = ("identity", "classic-mds", "learned")

#: Quantities of the page, in words.
RUN = {
    "run_seconds": "run, wall seconds on 2 cores",
    "ranking_seconds": "of it ranking, sum over jobs",
    "peak_mib": "memory of all processes, MiB",
    "disk_mib": "disk at the end, MiB",
    "most_disk_mib": "disk at most, before features and generated meshes go, MiB",
    "plan_seconds": "plan, seconds",
    "tables_seconds": "tables, seconds",
}
RANKING = {
    "matching_seconds": "matching one codebook on one core, seconds",
    "measures_seconds": "measures of one matrix, seconds",
    "ranking_peak_mib": "memory of matching, keeping and measures, MiB",
    "record_mib": "record of a job, MiB",
}
NEIGHBOURS = {
    "index_seconds": "index of one codebook once words are counted, processor seconds",
    "nearest_seconds": "neighbours of one codebook, processor seconds",
    "nearest_peak_mib": "memory of both, MiB",
    "nearest_disk_mib": "both on disk, MiB",
    "recall_1": "share of the nearest shapes that was found",
    "recall_k": "share of the 20 nearest that was found",
}
BEYOND_HEAD = """
## Neighbours, and where each stage breaks

`run --neighbours 20`, of made-up signatures as far apart as real ones: 500 bodies in 20 poses at 10 000 shapes. Beyond
20 000 shapes, neighbours of 2000 were looked for and the seconds multiplied. Shares are over 20 to 200 queries,
compared with all shapes. These forms have 800 keypoints, those of the matching 2640: `match_all` of 2000 of them takes
2.5 processor seconds, so all pairs of 10 000 about 63. Neighbours save memory first, and time beyond 10 000 shapes.
"""
BEYOND_FOOT = """
- **The matrix of all pairs** is the first wall: it alone fills 64 GiB at 92 000 shapes. With neighbours there is none.
- **Preparation** is the next: {hours:.0f} hours on one core at 100 000, {days:.0f} days at a million, divided by cores
  and machines (`--shard`, dask).
- **Candidates** are chosen by the inner products of all pairs of vectors, far less work than matching them,
  but still of all pairs: at a million shapes an index that looks at fewer would have to take its place.
- **Recall** falls where very many forms are nearly as near: of 100 000 made-up ones 5000 take the same pose, and 500
  candidates hold six in ten of the nearest.
- **Records** hold every query; beyond 32 MiB a file is refused as one, at about 450 000 shapes.

How many candidates, and which words, was chosen on bodies that no table uses, 200 forms by classic MDS and the 200
bodies themselves (`python -m tools.speed.recall "humans[subjects=20,poses=10]"`). Share of the K nearest that is found
among so many candidates, `K: candidates`, by the share of the entries of the vectors that is kept, the rarest words
first; 0.5 and ten candidates for each neighbour, at least 500, were taken. Other sets chose nothing:
"""


def figure_of(measured: dict[str, dict[str, float]], name: str, size: int) -> tuple[float, bool] | None:
    """A quantity at a size, and whether it was measured; else by the slope between two sizes that were, None of one."""
    points = sorted((int(at), found[name]) for at, found in measured.items() if name in found)
    known = dict(points)
    if size in known:
        return known[size], True
    if len(points) < 2:
        return None
    place = min(max(sum(at < size for at, _ in points), 1), len(points) - 1)
    (first, low), (second, high) = points[place - 1 : place + 1]
    if name.endswith("peak_mib"):  # most of it is there before the first shape
        return low + (high - low) / (second**2 - first**2) * (size**2 - first**2), False
    if name in ("disk_mib", "most_disk_mib"):  # forms, and distances of all pairs
        each_pair = (high / second - low / first) / (second - first)
        return (low / first + each_pair * (size - first)) * size, False
    slope = float(np.log(high / low) / np.log(second / first))
    return low * (size / first) ** slope, False


def page(measured: dict[str, dict[str, Any]]) -> str:
    """The page, from what was measured."""
    sizes = sorted(size for size in {*SIZES, *map(int, measured)} if size <= max(SIZES))
    lines = [
        "# Scale",
        "",
        "After this page you can say what a gallery of some size costs in seconds, memory and disk.",
        "Written by `python -m tools.speed.scale`; do not edit. A gallery of generated bodies in 20 poses each",
        f"(`-d humans[subjects=N,poses=20]`) through {', '.join(METHODS)}, mesh and view, and below it the ranking",
        "alone on made-up signatures. A figure behind ≈ was not measured: it follows from the slope between the",
        "nearest two sizes that were (of memory, from a constant and the square of the size; of disk, from the size",
        "and its square); what was measured at one size is extrapolated to no other. Plan and tables of 1000 and",
        "of 10 000 shapes are of made-up records as large as real ones. Scores say little there: of 500 bodies in the",
        "same 20 poses, the nearest to each is another body in its pose (complete surfaces: NN 0 for both methods).",
        "",
        "![Seconds against the number of shapes](../../results/figures/scale.png)",
        "",
        *markdown_table(_head(sizes), _rows(measured, RUN | RANKING, sizes)),
        *_parts(measured),
    ]
    with_stages = [(int(at), found["stages"]) for at, found in measured.items() if found.get("stages")]
    if with_stages:
        size, stages = max(with_stages, key=lambda pair: pair[0])
        names = list(dict.fromkeys(stage for found in stages.values() for stage in found))
        lines += ["", f"Seconds a shape by stage, median over {size} shapes, one core:", ""]
        lines += markdown_table(
            ["job", *names],
            [[job, *(_rounded(of[n]) if n in of else "" for n in names)] for job, of in sorted(stages.items())],
        )
    return "\n".join([*lines, *_beyond(measured)]) + "\n"


def _parts(measured: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield a table of each size whose inputs were run apart."""
    for size, found in measured.items():
        if parts := found.get("parts"):
            rest = "The column above sums them" if "run_seconds" in found else "The other has not been run yet"
            yield from ("", f"Of {size} shapes, inputs were run apart, and the seconds of a run that was stopped added")
            yield from (f"to those of the one that went on with what it had kept. {rest}:", "")
            rows = [[title, *(_rounded(part[name]) for part in parts.values())] for name, title in RUN.items()]
            yield from markdown_table(["", *parts], rows)


def _rounded(value: float) -> str:
    """Three digits, without a power of ten: ``"14900"``."""
    return f"{float(f'{value:.3g}'):.9g}"


def _head(sizes: Iterable[int]) -> list[str]:
    return ["", *(f"{size} shapes" for size in sizes)]


def _rows(measured: dict[str, dict[str, Any]], names: dict[str, str], sizes: Iterable[int]) -> Iterator[list[str]]:
    """Yield a row for each quantity; what follows from other sizes is marked."""
    for name, title in names.items():
        found = [figure_of(measured, name, size) for size in sizes]
        if name in NEIGHBOURS and not name.endswith("seconds"):  # no power of the size
            found = [each if each and each[1] else None for each in found]
        yield [title, *("--" if each is None else f"{'' if each[1] else '≈ '}{_rounded(each[0])}" for each in found)]


def _beyond(measured: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield what becomes of each stage far beyond what was run; nothing before there are neighbours."""
    sizes = sorted({*BEYOND, *(int(at) for at, found in measured.items() if "nearest_seconds" in found)})
    if not any("nearest_seconds" in found for found in measured.values()):
        return
    yield from (*BEYOND_HEAD.splitlines(), "")
    stages = max((found for found in measured.values() if found.get("stages")), key=lambda found: found["run_seconds"])
    rows = [
        *_rows(measured, {name: RANKING[name] for name in ("matching_seconds", "record_mib")}, sizes),
        *_rows(measured, NEIGHBOURS, sizes),
        ["matrix of all pairs, GiB", *(_rounded(8 * size**2 / 2**30) for size in sizes)],
        *(
            [
                f"{stage} of mesh classic-mds, hours on one core",
                *(f"≈ {_rounded(each * size / 3600)}" for size in sizes),
            ]
            for stage, each in stages["stages"]["mesh classic-mds"].items()
        ),
    ]
    yield from markdown_table(_head(sizes), rows)
    prepare = stages["stages"]["mesh classic-mds"]["prepare"]
    yield from BEYOND_FOOT.format(hours=prepare * 100_000 / 3600, days=prepare * 1_000_000 / 86_400).splitlines()
    for name, table in json.loads(RECALL.read_text()).items() if RECALL.exists() else ():
        yield from ("", f"{name}:", "", *table)


def draw(measured: dict[str, dict[str, Any]]) -> None:
    """Draw seconds against shapes; what was not measured is dashed."""
    mpl.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4), dpi=120)
    for name, title in (RUN | RANKING | NEIGHBOURS).items():
        if not name.endswith("seconds") or not any(name in found for found in measured.values()):
            continue
        sizes = sorted({*SIZES, *(int(at) for at, each in measured.items() if name in each)})
        found = [figure_of(measured, name, size) for size in sizes]
        values = [(size, each[0], each[1]) for size, each in zip(sizes, found, strict=True) if each]
        (line,) = axes.plot([v[0] for v in values], [v[1] for v in values], "--", linewidth=0.8)
        known = [v for v in values if v[2]]
        axes.plot([v[0] for v in known], [v[1] for v in known], "o-", color=line.get_color(), label=title)
    axes.set(xscale="log", yscale="log", xlabel="shapes", ylabel="seconds")
    axes.grid(color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    FIGURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURE, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def write(measured: dict[str, dict[str, Any]]) -> None:
    """Write the page and its figure anew."""
    draw(measured)
    PAGE.write_text(page(measured))

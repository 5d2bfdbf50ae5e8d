"""Time against the number of vertices: ``python -m tools.speed.growth``; writes ``results/growth.json`` and a figure.

Processor time of one thread, so that other work on the machine matters little.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Callable, Iterable, Mapping, Sequence  # noqa: E402
from functools import partial  # noqa: E402
from typing import Any  # noqa: E402

import matplotlib as mpl  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from benchmark.api.contracts import Mesh, Method, Shape  # noqa: E402
from benchmark.datasets.humans import Humans  # noqa: E402
from benchmark.geometry import geodesics  # noqa: E402
from benchmark.geometry.preparation import prepare  # noqa: E402
from benchmark.methods.registry import BUILT_IN, MethodSpec  # noqa: E402
from tools.speed._document import FIGURE, GROWTH, exponent, machine, write_document  # noqa: E402
from tools.speed._timing import Work, processor_seconds  # noqa: E402

mpl.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

SIZES = (500, 1000, 2000, 4000, 8000)
#: All geodesics go further, or as far as the body has vertices; forms would need many times their matrix of over 1 GB.
LARGEST = 16000
SETTINGS = {"limit": 60.0, "repeats": 3, "long_run": 5.0}
ALL_GEODESICS = "all geodesics"
SHORTEST_DRAWN = 1e-3
LABEL_STEP = 0.055


class Memory:
    """Keeps the artefacts of one mesh for several shapes."""

    def __init__(self) -> None:
        self._computed: dict[str, Mapping[str, NDArray[Any]]] = {}

    def get_or_compute(
        self, stage: str, parameters: Mapping[str, Any], compute: Callable[[], Mapping[str, NDArray[Any]]]
    ) -> Mapping[str, NDArray[Any]]:
        """Compute each stage once."""
        name = f"{stage} {sorted(parameters.items())}"
        if name not in self._computed:
            self._computed[name] = compute()
        return self._computed[name]


class WatchedShape(Shape):
    """Remembers which geodesics a method asked for."""

    def __init__(self, mesh: Mesh, memory: Memory) -> None:
        # A new mesh, for which no geodesic graph is remembered.
        super().__init__(identifier="body", mesh=Mesh(mesh.vertices.copy(), mesh.faces.copy()), cache=memory)
        self.asked: set[str] = set()

    def geodesics(self, solver: str = "default") -> NDArray[np.float64]:
        """Remember and pass on."""
        self.asked.add("all")
        return super().geodesics(solver)

    def geodesics_from(self, sources: Any, solver: str = "default") -> NDArray[np.float64]:
        """Remember and pass on."""
        self.asked.add("rows")
        return super().geodesics_from(sources, solver)


def main() -> None:
    """Measure, draw, and write the tables."""
    humans = Humans()
    body = humans.load(humans.entries[-1])
    bodies = [(prepare(body, size).mesh, Memory()) for size in SIZES]
    largest = prepare(body, LARGEST).mesh
    sizes = [*(mesh.n_vertices for mesh, _ in bodies), largest.n_vertices]
    rows = [report(geodesics_row([*bodies, (largest, Memory())]))]
    for name, target in BUILT_IN.items():
        method = MethodSpec(name, target).create()
        # A network takes the time of its model, and has none until one is trained.
        if isinstance(method, Method) and "mesh" in method.info.inputs and not target.startswith("learned."):
            rows.append(report(method_row(name, method, bodies)))
    found = {"machine": machine(), "settings": SETTINGS, "sizes": sizes, "rows": rows}
    GROWTH.write_text(json.dumps(found, indent=1) + "\n")
    draw(sizes, rows)
    print(f"wrote {GROWTH}, {FIGURE} and {write_document()}")


def geodesics_row(bodies: Sequence[tuple[Mesh, Memory]]) -> dict[str, Any]:
    """Time all pairs of geodesics."""
    geodesics.all_pairs(bodies[0][0])

    def ready(mesh: Mesh, memory: Memory) -> Work:
        return partial(geodesics.all_pairs, WatchedShape(mesh, memory).mesh)

    return {"name": ALL_GEODESICS, "takes_rows": False, **grow(partial(ready, *each) for each in bodies)}


def method_row(name: str, method: Method, bodies: Sequence[tuple[Mesh, Memory]]) -> dict[str, Any]:
    """Time a method; if it asks for all geodesics, they are there."""
    probe = WatchedShape(*bodies[0])
    method.canonicalise(probe)

    def ready(mesh: Mesh, memory: Memory) -> Work:
        shape = WatchedShape(mesh, memory)
        if "all" in probe.asked:
            shape.geodesics()
        return partial(method.canonicalise, shape)

    return {"name": name, "takes_rows": "rows" in probe.asked, **grow(partial(ready, *each) for each in bodies)}


def grow(runs: Iterable[Callable[[], Work]]) -> dict[str, Any]:
    """Time each size until one takes too long; a run makes what shall be timed."""
    seconds: list[float] = []
    for ready in runs:
        times = [processor_seconds(ready())]
        while times[0] < SETTINGS["long_run"] and len(times) < SETTINGS["repeats"]:
            times.append(processor_seconds(ready()))
        seconds.append(min(times))
        if seconds[-1] > SETTINGS["limit"]:
            break
    return {"seconds": seconds}


def report(row: dict[str, Any]) -> dict[str, Any]:
    """Print a row and return it."""
    print(f"{row['name']}: {', '.join(f'{seconds:.4g} s' for seconds in row['seconds'])}", flush=True)
    return row


def draw(sizes: Sequence[int], rows: Sequence[dict[str, Any]]) -> None:
    """Draw the rows that take long enough to matter, each with its name and exponent at its end."""
    shown = [row for row in rows if max(row["seconds"]) >= SHORTEST_DRAWN]
    shown.sort(key=lambda row: row["seconds"][-1])
    # The bright middle of the map would be hard to read as text.
    colours = 0.8 * mpl.colormaps["turbo"](np.linspace(0.03, 0.95, len(shown)))[:, :3]
    figure, axes = plt.subplots(figsize=(8.0, 5.6), dpi=150)
    for row, colour in zip(shown, colours, strict=True):
        style = "--" if row["name"] == ALL_GEODESICS else "-"
        axes.plot(sizes[: len(row["seconds"])], row["seconds"], style, marker="o", markersize=4, color=colour)
    axes.set(xscale="log", yscale="log", xlabel="vertices", ylabel="processor seconds, one thread")
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.minorticks_off()
    axes.grid(color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    ends = [(sizes[len(row["seconds"]) - 1], row["seconds"][-1]) for row in shown]
    heights = axes.transAxes.inverted().transform(axes.transData.transform(ends))[:, 1]
    for row, colour, end, height in zip(shown, colours, ends, _spread(heights), strict=True):
        growth = exponent(sizes, row["seconds"])
        line = {"arrowstyle": "-", "color": colour, "linewidth": 0.7, "relpos": (0, 0.5), "shrinkA": 0, "shrinkB": 3}
        axes.annotate(
            f"{row['name']}  $n^{{{growth}}}$" if growth else row["name"],
            end,
            xytext=(1.05, height),
            textcoords="axes fraction",
            va="center",
            color=colour,
            arrowprops=line,
        )
    FIGURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURE, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def _spread(heights: Sequence[float]) -> list[float]:
    """Move rising heights apart so that labels do not overlap, each as little as a shared shift allows."""
    steps = LABEL_STEP * np.arange(len(heights))
    moved = np.maximum.accumulate(np.asarray(heights) - steps) + steps
    lowered = np.minimum.accumulate((np.asarray(heights) - steps)[::-1])[::-1] + steps
    return [float(height) for height in (moved + lowered) / 2]


if __name__ == "__main__":
    main()

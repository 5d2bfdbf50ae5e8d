"""Curves of robustness: one panel per perturbation, one line per method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmark.datasets.perturbations.dataset import PERTURBATIONS
from benchmark.report.pictures.forms import save
from benchmark.report.robustness import Robustness

_COLUMNS = 4
_MARKERS = "os^vD<>p*hXP"


def draw_curves(found: Sequence[Robustness], folder: Path) -> list[Path]:
    """Write a picture for each data set and input."""
    paths = [folder / f"{each.file_stem}.png" for each in found]
    for each, path in zip(found, paths, strict=True):
        save(curves_figure(each), path)
    return paths


def curves_figure(found: Robustness) -> Figure:
    """NN over the strength of each perturbation, from clean on the left."""
    columns = min(_COLUMNS, len(found.curves) + 1)
    rows = -(-(len(found.curves) + 1) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.8 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    colours = mpl.colormaps["tab20"].colors  # type: ignore[attr-defined]
    looks = {
        method: {"color": colours[k % len(colours)], "marker": _MARKERS[k % len(_MARKERS)]}
        for k, method in enumerate(found.titles)
    }
    for place, (perturbation, curves) in zip(axes, found.curves.items(), strict=False):
        known = PERTURBATIONS[perturbation]
        for method, curve in curves.items():
            values = [float("nan") if value is None else value for value in (curve.clean, *curve.values)]
            place.plot(range(len(values)), values, markersize=3, linewidth=1, **looks[method])
        place.axhline(next(iter(curves.values())).chance, color="grey", linestyle=":", linewidth=1)
        place.set_title(known.title, fontsize=9)
        place.set_xlabel(known.unit, fontsize=7)
        place.set_xticks(range(len(known.amounts) + 1), ["clean", *(f"{a:g}" for a in known.amounts)], fontsize=7)
        place.set_xlim(-0.2, len(known.amounts) + 0.2)
        place.set_ylim(-0.03, 1.03)
        place.tick_params(labelsize=7)
    for place in axes[len(found.curves) :]:
        place.axis("off")
    legend = axes[len(found.curves)]
    for method, title in found.titles.items():
        legend.plot([], [], label=title.replace("$", r"\$"), markersize=3, linewidth=1, **looks[method])
    legend.plot([], [], color="grey", linestyle=":", linewidth=1, label="chance")
    legend.legend(fontsize=6, loc="center", ncols=2 if len(looks) > 12 else 1, frameon=False)
    figure.supylabel("NN", fontsize=9)
    return figure

"""Curves of robustness: one panel per perturbation, one line per method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmark.datasets.perturbations.dataset import PERTURBATIONS
from benchmark.report.pictures.forms import save
from benchmark.report.robustness import file_stem, titles

if TYPE_CHECKING:
    from pandas import DataFrame

_COLUMNS = 4
_MARKERS = "os^vD<>p*hXP"


def draw_curves(found: Sequence[DataFrame], folder: Path) -> list[Path]:
    """Write a picture for each data set and input."""
    paths = [folder / f"{file_stem(each)}.png" for each in found]
    for each, path in zip(found, paths, strict=True):
        save(curves_figure(each), path)
    return paths


def curves_figure(found: DataFrame) -> Figure:
    """NN over the strength of each perturbation, from clean on the left."""
    n_curves = found["perturbation"].nunique()
    columns = min(_COLUMNS, n_curves + 1)
    rows = -(-(n_curves + 1) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.8 * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    colours = mpl.colormaps["tab20"].colors  # type: ignore[attr-defined]
    looks = {
        method: {"color": colours[k % len(colours)], "marker": _MARKERS[k % len(_MARKERS)]}
        for k, method in enumerate(titles(found))
    }
    for place, (perturbation, part) in zip(axes, found.groupby("perturbation", sort=False), strict=False):
        known = PERTURBATIONS[str(perturbation)]
        for method, curve in part.groupby("method", sort=False):
            values = [curve["clean_NN"].iloc[0], *curve["NN"].astype(float)]
            place.plot(range(len(values)), values, markersize=3, linewidth=1, **looks[str(method)])
        place.axhline(part["chance"].iloc[0], color="grey", linestyle=":", linewidth=1)
        place.set_title(known.title, fontsize=9)
        place.set_xlabel(known.unit, fontsize=7)
        place.set_xticks(range(len(known.amounts) + 1), ["clean", *(f"{a:g}" for a in known.amounts)], fontsize=7)
        place.set_xlim(-0.2, len(known.amounts) + 0.2)
        place.set_ylim(-0.03, 1.03)
        place.tick_params(labelsize=7)
    for place in axes[n_curves:]:
        place.axis("off")
    legend = axes[n_curves]
    for method, title in titles(found).items():
        legend.plot([], [], label=title.replace("$", r"\$"), markersize=3, linewidth=1, **looks[method])
    legend.plot([], [], color="grey", linestyle=":", linewidth=1, label="chance")
    legend.legend(fontsize=6, loc="center", ncols=2 if len(looks) > 12 else 1, frameon=False)
    figure.supylabel("NN", fontsize=9)
    return figure

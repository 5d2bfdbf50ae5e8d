"""What networks predict: ``python results/experiments/predictions.py``.

Draws three unseen subjects in two poses (results/figures/predictions.png), and writes hidden.csv:
of the canonical pixels whose surface point is hidden in the input, the share that lies in the
predicted mask, and the error of the depth there in units of relief (the standard deviation of the
true depth inside the true mask)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas
import torch
from depth_range import JUDGES, TRAINED, average_body, training_bodies
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.geometry.camera import Camera
from benchmark.geometry.depth import camera_coordinates, render_depth
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.prepared import frame_of
from benchmark.report.grids import ON_WHITE, TEXT_WIDTH, write_figure
from learned.images import COVERED, resampled
from learned.methods import Learned

POSES = ("sitting", "kicking")  # chosen before any picture was drawn
N_SHOWN = 3
FOLD = 0
BEHIND = 0.01
"""Depth behind what the camera sees, as a share of the frame, from which a point is hidden: 2.6 cm.
"""

HERE = Path(__file__).parent
AVERAGE = "average body"


def hidden(
    canonical: Mesh, posed: Mesh, camera: Camera, half_width: float, mask: NDArray[np.bool_]
) -> Tensor:
    """Return which pixels of the true canonical mask show a point that is hidden in the input,
    shape (r, r).

    The point of a pixel is the nearest vertex; both meshes have the same vertices.
    """
    size = len(mask)
    points, elsewhere = (
        camera_coordinates(mesh, camera) / half_width for mesh in (canonical, posed)
    )
    depth, seen = (render_depth(mesh, camera, half_width, size) for mesh in (canonical, posed))
    rows, columns = np.nonzero(mask & (depth > 0))
    x, y = ((places + 0.5) * (2 / size) - 1 for places in (columns, rows))
    _, nearest = cKDTree(points).query(np.stack([x, -y, 2 * depth[rows, columns] - 1], axis=1))
    moved = elsewhere[nearest]
    column, row = np.clip(((moved[:, :2] * [1, -1] + 1) * (size / 2)).astype(int), 0, size - 1).T
    found = np.zeros_like(mask)
    found[rows, columns] = seen[row, column] > (1 + moved[:, 2]) / 2 + BEHIND
    return torch.from_numpy(found)


def figures(prediction: Tensor, true: Tensor, unseen: Tensor) -> tuple[float, float]:
    """Return the share of hidden pixels in the predicted mask, and the error of the depth there in
    units of relief.
    """
    mask = prediction[1] > COVERED
    both = mask & (true[1] > COVERED)
    there = mask & unseen
    wrong = prediction[0] - true[0]
    wrong = wrong - wrong[both].mean()
    relief = true[0][true[1] > COVERED].std(correction=0)
    return float(there.sum() / unseen.sum()), float(wrong[there].square().mean().sqrt() / relief)


def main() -> None:
    """Draw the picture and write the figures."""
    torch.set_num_threads(1)
    models = Learned.shipped_models / f"people-fold-{FOLD}"
    networks = {
        "128 px": (Learned().load(models / "literal-seed0"), 128),
        "as printed": (Learned(configuration="as_printed").load(models / "as_printed-seed0"), 500),
    }
    shapes = open_dataset(JUDGES)
    half_width = frame_of(open_dataset(TRAINED))
    canonical = canonical_shapes(shapes)
    rows = []
    drawn = []
    chosen = []
    for pose in POSES:
        chosen += [entry for entry in shapes.shapes if entry.pose == pose]
    for entry in chosen:
        posed = shapes.load(entry)
        standing = shapes.load(canonical[entry.subject])
        camera = shapes.camera(entry)
        image, true_image = (render_depth(mesh, camera, half_width) for mesh in (posed, standing))
        panels = [np.where(image > 0, image, np.nan)]
        for name, (network, size) in networks.items():
            true = torch.from_numpy(resampled(true_image, size)).double()
            unseen = hidden(standing, posed, camera, half_width, true[1].numpy() > COVERED)
            average = torch.stack(
                [average_body(FOLD, size), training_bodies(FOLD, size)[:, 1].mean(0)]
            )
            predicted = network.predict(image)
            for who, given in ((name, predicted), (f"{AVERAGE}, {size} pixels", average)):
                share, wrong = figures(given, true, unseen)
                rows.append(
                    {
                        "pose": entry.pose,
                        "body": entry.subject,
                        "of": who,
                        "in mask": share,
                        "error": wrong,
                    }
                )
            panels += [inside(true)] if len(panels) == 1 else []
            panels.append(inside(predicted))
        panels.append(inside(average))
        if entry.subject in [*dict.fromkeys(each.subject for each in shapes.shapes)][:N_SHOWN]:
            drawn.append((entry.subject, panels))
    table = pandas.DataFrame(rows).drop_duplicates(["pose", "body", "of"]).round(4)
    table.to_csv(HERE / "hidden.csv", index=False, lineterminator="\n")
    print(
        table.groupby(["pose", "of"], sort=False)[["in mask", "error"]].mean().round(2).to_string()
    )
    titles = ["input", "truth", *networks, f"{AVERAGE} of training"]
    drawn.sort(key=lambda pair: pair[0])
    write_figure(
        picture([panels for _, panels in drawn], titles),
        HERE.parent / "figures" / "predictions.png",
    )


def inside(prediction: Tensor) -> NDArray[np.float64]:
    """Return the depth inside the mask about its mean, NaN outside."""
    depth = prediction[0].numpy().astype(np.float64)
    mask = prediction[1].numpy() > COVERED
    return np.where(mask, depth - depth[mask].mean(), np.nan)


def picture(rows: list[list[NDArray[np.float64]]], titles: list[str]) -> Figure:
    """Draw a row of panels for each view; depth in one scale, but the input in its own.

    The picture is transparent, and its words stand on white.
    """
    size = (TEXT_WIDTH, 1.1 * TEXT_WIDTH * len(rows) / len(titles))
    figure = Figure(size, layout="constrained", facecolor="none")
    places = figure.subplots(len(rows), len(titles), squeeze=False)
    for first, row, panels in zip([True, *[False] * len(rows)], places, rows, strict=False):
        for number, (place, panel, title) in enumerate(zip(row, panels, titles, strict=True)):
            limits = {} if number == 0 else {"vmin": -0.05, "vmax": 0.05}
            place.imshow(panel, cmap="viridis", interpolation="nearest", **limits)
            place.set_axis_off()
            place.set_xlim(0.16 * len(panel), 0.84 * len(panel))
            place.set_ylim(0.86 * len(panel), 0.13 * len(panel))
            if first:
                place.set_title(title, fontsize=7, bbox=ON_WHITE)
    label = "depth about its mean, by the depth of the frame (not of inputs)"
    add_scale(figure, places, label, shrink=0.4)
    return figure


def add_scale(figure: Figure, places: NDArray[np.object_], label: str, shrink: float) -> None:
    """Add the scale of colours of the predicted depths, a share of the figure's height."""
    bar = figure.colorbar(places[0, 1].images[0], ax=places, shrink=shrink, aspect=30, pad=0.01)
    bar.set_label(label, fontsize=7, bbox=ON_WHITE)
    for words in bar.ax.get_yticklabels():
        words.set(fontsize=7, bbox=ON_WHITE)


if __name__ == "__main__":
    main()

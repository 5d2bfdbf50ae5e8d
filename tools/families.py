"""Pictures for ``docs/reference/methods.md``: ``python -m tools.families FOLDER``."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmark.api.contracts import Mesh, Method, Shape
from benchmark.datasets.humans import Humans
from benchmark.geometry.camera import Camera
from benchmark.geometry.preparation import prepare
from benchmark.plugins.registry import methods, variant
from benchmark.report.pictures.painting import save, shaded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Methods of each family, by the name of its picture.
FAMILIES: Mapping[str, Sequence[str]] = {
    "scaling": ("classic-mds", "least-squares-mds", "non-metric-mds"),
    "few-rows": ("fast-mds", "accelerated-mds", "fast-classical-scaling", "nystrom-mds", "subspace-mds"),
    "metrics": (
        *(f"classic-mds[metric={metric}]" for metric in ("diffusion", "commute-time", "biharmonic")),
        *(f"least-squares-mds[metric={metric}]" for metric in ("diffusion", "commute-time", "biharmonic")),
        "gps",
    ),
    "details": (
        "constrained-mds",
        "feature-preserved",
        "skeleton",
        "mesh-unfolding",
        "euclidean-distance",
        "euclidean-distance[points=local]",
    ),
}

#: Generated body whose poses are shown, and which of them.
SUBJECT, POSES = "woman-3", (0, 7, 13)


def family_figure(names: Sequence[str], poses: Sequence[Mesh], camera: Camera, size: int = 150) -> Figure:
    """Draw the same poses as they are, and below what each method makes of them.

    Parameters
    ----------
    names
        Methods, with parameters if need be.
    poses
        Prepared surfaces.
    camera
        How the surfaces are looked at; forms are seen along their third principal axis.
    size
        Pixels per picture.
    """
    from matplotlib.figure import Figure

    known = methods()
    specs = [variant(name, known) for name in names]
    rows = [("input", [np.asarray(shaded(mesh, camera, size)) / 255 for mesh in poses])]
    for spec in specs:
        method = spec.create()
        if isinstance(method, Method):
            shapes = [Shape(identifier=f"pose {number}", mesh=mesh) for number, mesh in enumerate(poses)]
            forms = [method.canonicalise(shape).mesh for shape in shapes]
            rows.append((spec.title, [np.asarray(shaded(principal_frame(form), size=size)) / 255 for form in forms]))
    figure = Figure(figsize=(1.2 * len(rows) + 0.4, 1.2 * len(poses) + 0.3), dpi=100)
    axes = figure.subplots(len(poses), len(rows), squeeze=False, gridspec_kw={"wspace": 0.02, "hspace": 0.02})
    for column, (title, pictures) in enumerate(rows):
        axes[0, column].set_title(title.replace(" (", "\n("), fontsize=6)
        for row, picture in enumerate(pictures):
            axes[row, column].imshow(picture, interpolation="antialiased")
            axes[row, column].set_axis_off()
    return figure


def principal_frame(mesh: Mesh) -> Mesh:
    """The mesh turned so that its longest axis is upright and its shortest one looks at the viewer.

    The forms of most methods have no orientation of their own; this one shows them at their widest.
    """
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    turned = centred @ axes.T
    # Longest axis upwards (z), second across (x), shortest along the view (y); heavier tails up and right.
    turned = turned[:, [1, 2, 0]] * np.where((turned[:, [1, 2, 0]] ** 3).sum(axis=0) < 0, -1.0, 1.0)
    return mesh.with_vertices(turned)


def main(folder: Path) -> None:
    """Write one picture per family."""
    humans = Humans()
    entries = [entry for entry in humans.entries if entry.subject == SUBJECT]
    chosen = [entries[pose] for pose in POSES]
    poses = [prepare(humans.load(entry)).mesh for entry in chosen]
    for family, names in FAMILIES.items():
        save(family_figure(names, poses, humans.camera(chosen[0])), folder / f"family-{family}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""Shapes for the checks: a figure in three poses, its views, and surfaces hard to treat."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from benchmark.api.contracts import Mesh, Shape
from benchmark.api.learning import TrainingData, TrainingPair, digest_of
from benchmark.geometry.camera import Camera
from benchmark.geometry.depth import back_project, fit_half_width, render_depth

#: Angles in radians by which the limbs of the figure bend, one for each pose.
BENDS = (0.7, 0.2, 1.1)

#: Name of the training on images of the figure, and of the folder of its models.
TRAINING = "figure"

#: Pixels between the samples of the surface of a view.
_PIXEL_STRIDE = 9

#: Camera of the views, across all axes.
_CAMERA = Camera((0.35, 1.0, -0.2))


@cache
def _mesh(name: str) -> Mesh:
    """Return a mesh of the file of shapes."""
    with np.load(Path(__file__).with_name("shapes.npz"), allow_pickle=False) as arrays:
        return Mesh(arrays[f"{name} vertices"], arrays[f"{name} faces"])


def figure(bend: float = BENDS[0]) -> Mesh:
    """Return the closed surface of a body with a head, an arm, a leg and a tail, of unit area.

    It has 500 vertices. All limbs differ in length, thickness and direction, so no symmetry leaves
    an axis or the order of two eigenvalues undetermined.

    Parameters
    ----------
    bend
        Angle of :data:`BENDS` by which the arm, the leg and the tail bend at every joint.
    """
    return _mesh(f"figure {bend}")


@cache
def view(bend: float = BENDS[0]) -> Shape:
    """Return the figure as one depth camera sees it: open, in bridged pieces, with its image."""
    mesh = figure(bend)
    half_width = fit_half_width(mesh, _CAMERA)
    depth = render_depth(mesh, _CAMERA, half_width)
    surface, _ = back_project(depth, half_width, _PIXEL_STRIDE)
    unit = surface.with_vertices(surface.vertices / np.sqrt(surface.area))
    return Shape(identifier=f"view {bend}", mesh=unit, depth=depth, source_area=surface.area)


def awkward() -> dict[str, Mesh]:
    """Return valid meshes that a method may refuse but must not crash on, by name."""
    names = ("a triangle", "a tetrahedron", "a flat sheet", "two pieces")
    return {name: _mesh(name) for name in names} | {"an open surface": view().mesh}


def training_on_figure() -> TrainingData:
    """Return training data for a check: depth images of the figure in its poses.

    The first pose is the canonical one. The same images serve for validation, and none for a test,
    because a check looks at how a model is trained and stored, not at how good it is.
    """
    names = tuple(f"figure {bend}" for bend in BENDS)

    def pairs() -> Iterator[TrainingPair]:
        """Yield each image, with that of the canonical pose."""
        images = [np.asarray(view(bend).depth) for bend in BENDS]
        for name, image in zip(names, images, strict=True):
            yield TrainingPair(
                identifier=name,
                subject="figure",
                target_identifier=names[0],
                image=image,
                target=images[0],
            )

    return TrainingData(
        name=TRAINING,
        title="the reference figure",
        subjects=("figure",),
        identifiers=names,
        tested=digest_of(()),  # of no subjects
        pairs=pairs,
        n_pairs=len(BENDS),
        validation=pairs,
        n_validation=len(BENDS),
    )

"""What plugins are tried on: a figure with limbs in a few poses, surfaces that are hard to treat, training data."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from benchmark.api.contracts import Mesh, Shape
from benchmark.api.learning import TrainingData, TrainingPair
from benchmark.geometry.camera import Camera
from benchmark.geometry.depth import back_project, fit_half_width, render_depth

#: Angles in radians by which the limbs of the figure bend in its poses.
BENDS = (0.7, 0.2, 1.1)

#: Name of the training on images of the figure, and so of the folder that holds its models.
TRAINING = "case"

_PIXEL_STRIDE = 9
_CAMERA = Camera((0.35, 1.0, -0.2))


#: Valid meshes that a method may refuse as unsupported, but must not stumble over, beside the open surface of a view.
_AWKWARD = ("a triangle", "a tetrahedron", "a flat sheet", "two pieces")


@cache
def _mesh(name: str) -> Mesh:
    with np.load(Path(__file__).with_name("shapes.npz"), allow_pickle=False) as arrays:
        return Mesh(arrays[f"{name} vertices"], arrays[f"{name} faces"])


def figure(bend: float = BENDS[0]) -> Mesh:
    """Closed surface of a body with a head, an arm, a leg and a tail, of unit area and 500 vertices.

    No two limbs share length, thickness or direction, so the surface has no symmetry that would leave an axis or the
    order of two eigenvalues open.

    Parameters
    ----------
    bend
        Angle of :data:`BENDS` by which the arm, the leg and the tail each turn at every joint.
    """
    return _mesh(f"figure {bend}")


@cache
def view(bend: float = BENDS[0]) -> Shape:
    """The figure as one depth camera sees it: open, in pieces that are bridged, with its depth image."""
    mesh = figure(bend)
    half_width = fit_half_width([mesh], _CAMERA)
    depth = render_depth(mesh, _CAMERA, half_width)
    depth.flags.writeable = False
    surface, _ = back_project(depth, half_width, _PIXEL_STRIDE)
    area = surface.area
    return Shape(
        identifier=f"view of the figure bent by {bend}",
        mesh=surface.with_vertices(surface.vertices / np.sqrt(area)),
        depth=depth,
        source_area=area,
    )


def awkward() -> dict[str, Mesh]:
    """Meshes that are hard to treat, by name."""
    return {name: _mesh(name) for name in _AWKWARD} | {"an open surface": view().mesh}


def training_data() -> TrainingData:
    """Depth images of the figure in its poses, the first of which is the canonical one; all that training may see."""
    names = tuple(f"figure {bend}" for bend in BENDS)

    def pairs(start: int = 0) -> Iterator[TrainingPair]:
        images = [image for bend in BENDS if (image := view(bend).depth) is not None]
        for name, image in list(zip(names, images, strict=True))[start:]:
            yield TrainingPair(
                identifier=name, subject="figure", target_identifier=names[0], image=image, target=images[0]
            )

    return TrainingData(
        name=TRAINING,
        title="the reference figure",
        digest=hashlib.sha256(" ".join(names).encode()).hexdigest(),
        subjects=("figure",),
        identifiers=names,
        n_pairs=len(BENDS),
        pairs=pairs,
        unseen=pairs,
    )

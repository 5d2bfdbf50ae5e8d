"""A trained streamed network: loading, prediction, and the closed surface of front and back."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from benchmark.api.learning import card_digest, read_card
from benchmark.errors import UnsupportedShape
from benchmark.geometry.depth import SAMPLES, SIZE, DepthImage, back_project
from benchmark.geometry.mesh import Mesh
from learned.described import described_in
from learned.images import checked_image, enlarge, surface_behind
from learned.streamed.configuration import Streamed, from_card
from learned.streamed.images import seen_by
from learned.streamed.network import StreamedNetwork, build_streamed
from learned.weights import with_weights


def configuration_of(card: Mapping[str, Any], folder: Path) -> Streamed:
    """Return the configuration on a card.

    Raises
    ------
    ConfigurationError
        If the card belongs to another kind of model.
    """
    return from_card(described_in(card, "streamed", folder, "a streamed network"))


def load_streamed(folder: Path) -> tuple[StreamedNetwork, Streamed]:
    """Load the network in a folder, ready to predict, and its configuration.

    Raises
    ------
    ConfigurationError
        If the weights do not match the card, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=4)
def _load(folder: Path, _digest: str) -> tuple[StreamedNetwork, Streamed]:
    configuration = configuration_of(read_card(folder), folder)
    return with_weights(build_streamed(configuration), folder, configuration.name), configuration


@torch.inference_mode()
def predicted(network: StreamedNetwork, configuration: Streamed, depth: DepthImage) -> Tensor:
    """Predict the depth of each side and the mask, shape (sides + 1, r, r), from an image of shape (500, 500).

    Raises
    ------
    InvalidMesh, UnsupportedShape
        If the image does not fit, or is empty.
    """
    image = torch.from_numpy(seen_by(configuration, checked_image(depth)[None]))[None].double()
    prediction: Tensor = network(image.contiguous(memory_format=torch.channels_last))[0]
    return prediction


def form_of(prediction: Tensor) -> tuple[Mesh, dict[str, float | str]]:
    """Return the surface of unit area behind a prediction, closed if it has two sides, and notes about it.

    Parameters
    ----------
    prediction
        Output of :func:`predicted`.

    Raises
    ------
    UnsupportedShape
        If the network predicts an empty mask.
    """
    front, mask = enlarge(prediction[[0, -1]]), prediction[-1]
    if len(prediction) == 2:
        return surface_behind(front)
    return closed_surface(front, enlarge(torch.stack([prediction[1], mask])))


THINNEST = 0.004
"""Smallest distance between front and back, as a share of half the frame: less than that between two samples, so that a
surface is thin, not inside out, where its predicted sides cross."""


def closed_surface(front: DepthImage, back: DepthImage) -> tuple[Mesh, dict[str, float | str]]:
    """Return the closed surface of unit area behind two depth images, and notes about it.

    The front is triangulated like a view, without cuts inside the mask and with bridges between its pieces. The back
    gets the same triangles, flipped, and a wall of triangles runs along each border. So the surface is closed whatever
    the images contain.

    Parameters
    ----------
    front, back
        Depth of the nearest and of the farthest surface from the same viewpoint, shape (500, 500), 0 outside the mask
        of the front.

    Raises
    ------
    UnsupportedShape
        If the mask is empty.
    """
    seen = front > 0
    if not seen.any():
        raise UnsupportedShape("the network predicts an empty mask", "train it for longer or on shapes like this one")
    # Each side gets half of the vertices of a form.
    stride = max(1, round(math.sqrt(np.count_nonzero(seen) / (SAMPLES / 2))))
    side, report = back_project(front, 1.0, stride=stride, jump=math.inf)
    behind = np.minimum(2 * _below(side.vertices, back, seen) - 1, side.vertices[:, 2] - THINNEST)
    twins = np.column_stack([side.vertices[:, :2], behind])
    surface = Mesh(np.concatenate([side.vertices, twins]), _joined(side))
    notes: dict[str, float | str] = {
        "predicted_foreground": report.foreground,
        "predicted_pieces": report.pieces,
        "predicted_bridges": report.bridges,
        "predicted_crossings": float(np.mean(behind == side.vertices[:, 2] - THINNEST)),
    }
    return surface.with_vertices(surface.vertices / surface.area**0.5), notes


def _below(vertices: NDArray[np.float64], back: DepthImage, seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the depth of the back at vertices of the front; on bridges outside the mask, at the nearest mask pixel."""
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    # Vertices are centres of pixels, so rounding down is far from a tie.
    column, row = np.clip(((vertices[:, :2] * [1, -1] + 1) * (SIZE / 2)).astype(np.int64), 0, SIZE - 1).T
    return np.asarray(back[rows[row, column], columns[row, column]], dtype=np.float64)


def _joined(side: Mesh) -> NDArray[np.int32]:
    """Return the triangles of the front, the back, and the wall along every border, shape (m, 3)."""
    count = side.n_vertices
    tails, heads = side.faces.ravel(), np.roll(side.faces, -1, axis=1).ravel()
    forward = tails.astype(np.int64) * count + heads
    single = ~np.isin(forward, heads.astype(np.int64) * count + tails)
    i, j = tails[single], heads[single]
    wall = np.concatenate([np.stack([j, i, i + count], axis=1), np.stack([j, i + count, j + count], axis=1)])
    return np.concatenate([side.faces, side.faces[:, ::-1] + count, wall]).astype(np.int32)

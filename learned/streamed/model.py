"""A trained streamed network, from its files to forms."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from benchmark.api.learning import card_digest, read_card
from benchmark.geometry.depth import DepthImage
from benchmark.geometry.mesh import Mesh
from learned.described import described_in
from learned.images import checked_image, enlarge
from learned.streamed.configuration import Streamed, from_card
from learned.streamed.images import seen_by
from learned.streamed.network import StreamedNetwork, build_streamed
from learned.streamed.stitching import closed_surface
from learned.surface import surface_behind
from learned.weights import with_weights


def configuration_of(card: Mapping[str, Any], folder: Path) -> Streamed:
    """Configuration that a card names.

    Raises
    ------
    ConfigurationError
        If it is the card of another kind of model.
    """
    return from_card(described_in(card, "streamed", folder, "a streamed network"))


def load_streamed(folder: Path) -> tuple[StreamedNetwork, Streamed]:
    """Network with the weights in a folder, ready to predict, and its configuration.

    Raises
    ------
    ConfigurationError
        If the weights are not those that the card describes, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=4)
def _load(folder: Path, _digest: str) -> tuple[StreamedNetwork, Streamed]:
    configuration = configuration_of(read_card(folder), folder)
    return with_weights(build_streamed(configuration), folder, configuration.name), configuration


@torch.inference_mode()
def predicted(network: StreamedNetwork, configuration: Streamed, depth: DepthImage) -> Tensor:
    """Depth of each side and the mask, shape (sides + 1, r, r), from a depth image of shape (500, 500).

    Raises
    ------
    InvalidMesh, UnsupportedShape
        If the image does not fit, or shows nothing.
    """
    image = torch.from_numpy(seen_by(configuration, checked_image(depth)[None]))[None]
    prediction: Tensor = network(image.contiguous(memory_format=torch.channels_last))[0]
    return prediction


def form_of(prediction: Tensor) -> tuple[Mesh, dict[str, float | str]]:
    """Surface of unit area behind a prediction, closed where it has two sides, and facts about it.

    Parameters
    ----------
    prediction
        As from :func:`predicted`.

    Raises
    ------
    UnsupportedShape
        If the network predicts an empty mask.
    """
    front, mask = enlarge(prediction[[0, -1]]), prediction[-1]
    if len(prediction) == 2:
        return surface_behind(front)
    return closed_surface(front, enlarge(torch.stack([prediction[1], mask])))
